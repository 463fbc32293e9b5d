"""One scene of one size in a process of its own: seconds of each stage as JSON. Called by `scaling`."""

from __future__ import annotations

import argparse
import json
import time

import lmoc


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--stop", type=float)
    parser.add_argument("--points", type=int, default=11)
    parser.add_argument("--only-compile", action="store_true")
    arguments = parser.parse_args()
    parameters = {name: float(value) for name, value in (text.split("=") for text in arguments.set)}
    parameters = {name: int(v) if v == int(v) else v for name, v in parameters.items()}
    lmoc.compile_text("model M Mass m(m = 1); end M;")  # imports are measured by `startup`
    begin = time.perf_counter()
    dae = lmoc.compile(arguments.file, parameters=parameters)
    result = {
        "equations": dae.flat.equation_count,
        "states": len(dae.states),
        "parse": dae.timings["parse"],
        "flatten": dae.timings["flatten"],
        "reduce": dae.timings["reduce"],
        "ready": time.perf_counter() - begin,
    }
    if not arguments.only_compile:
        begin = time.perf_counter()
        run = dae.simulate(stop=arguments.stop, points=arguments.points)
        total = time.perf_counter() - begin
        stats = run.stats
        result |= {
            "lower": stats["lower_seconds"],
            "initialize": stats["start_seconds"],
            "simulate": total - stats["lower_seconds"] - stats["start_seconds"],
            "solver": stats["solver"],
            "evaluation": stats["evaluation"],
            "steps": stats.get("steps"),
            "balance": run.energy.balance,
        }
        result["ready"] += stats["lower_seconds"] + stats["start_seconds"]
    print(json.dumps(result))


if __name__ == "__main__":
    main()
