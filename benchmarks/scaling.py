"""Time and memory of each stage against the size of a scene, with fitted slopes and a log–log picture.

    python -m benchmarks.scaling [--largest 100000] [--scenes]

Each size runs in a process of its own, so that its peak memory is its own. The caches of the grammar, the library and
the compiled kernels are warm; what filling them costs once on a machine is not shown.
"""

from __future__ import annotations

import argparse
import math

from benchmarks.common import RESULTS, ROOT, in_process, save, table

STAGES = ("flatten", "reduce", "lower", "initialize", "simulate")
SCENES = (  # a chain's network, drivetrain and so on at a size that hurts
    ("network.lmo", {"N": 320}),
    ("network.lmo", {"N": 5000}),
    ("network.lmo", {"N": 50000}),
    ("lattice.lmo", {"N": 100}),
    ("drivetrain.lmo", {"N": 10000}),
    ("ground.lmo", {"N": 10000}),
    ("gear_tree.lmo", {}),
    ("levers.lmo", {}),
)


def slope(sizes: list[int], seconds: list[float]) -> float:
    """Least-squares exponent of seconds ~ size^p over the sizes where a stage takes more than 20 ms."""
    points = [(math.log(n), math.log(s)) for n, s in zip(sizes, seconds, strict=True) if s > 20e-3]
    if len(points) < 2:
        return math.nan
    mean_x = sum(x for x, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    over = sum((x - mean_x) * (y - mean_y) for x, y in points)
    return over / sum((x - mean_x) ** 2 for x, _ in points)


def chain(sizes: list[int]) -> list[dict]:
    figures = []
    for n in sizes:
        arguments = ["models/bench/chain.lmo", "--set", f"N={n}", "--set", f"mode={max(3, n // 20)}"]
        if n > 200_000:
            arguments.append("--only-compile")
        figures.append({"N": n, **in_process("benchmarks.one_size", *arguments)})
    return figures


def print_chain(figures: list[dict]) -> None:
    sizes = [f["N"] for f in figures]
    rows = [
        [f["N"], f["equations"], f["states"], *(f.get(s) for s in STAGES), f["ready"], f["memory"], f.get("evaluation")]
        for f in figures
    ]
    exponents = [slope(sizes, [f.get(s, 0.0) for f in figures]) for s in (*STAGES, "ready")]
    rows.append(["slope", "", "", *exponents, "", ""])
    table(
        "chain of masses, springs and dampers: seconds (memory in MB)",
        ["N", "equations", "states", *STAGES, "text→ready", "memory", "by"],
        rows,
    )


def scenes() -> list[dict]:
    figures = []
    for file, parameters in SCENES:
        settings = [f"--set={name}={value}" for name, value in parameters.items()]
        result = in_process("benchmarks.one_size", f"models/bench/{file}", *settings, timeout=3000)
        figures.append({"scene": file.removesuffix(".lmo"), **parameters, **result})
    keys = ("scene", "N", "equations", "states", "ready", "simulate", "solver", "evaluation", "memory")
    rows = [[f.get(key) for key in keys] for f in figures]
    table("other scenes: seconds (ready: from text to the first step; memory in MB)", keys, rows)
    return figures


def picture(figures: list[dict]) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    sizes = [f["N"] for f in figures]
    fig, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for stage in (*STAGES, "ready"):
        known = [(n, f[stage]) for n, f in zip(sizes, figures, strict=True) if f.get(stage)]
        style = {"color": "black", "linewidth": 2} if stage == "ready" else {}
        left.loglog(*zip(*known, strict=True), "o-", label="text → ready" if stage == "ready" else stage, **style)
    base = figures[0]["ready"]
    left.loglog(sizes, [base * n / sizes[0] for n in sizes], ":", color="gray", label="∝ N")
    left.set(xlabel="masses", ylabel="seconds", title="Time of each stage")
    left.legend(fontsize=8)
    right.loglog(sizes, [f["memory"] for f in figures], "o-", color="tab:purple")
    right.set(xlabel="masses", ylabel="MB", title="Peak memory")
    for axes in (left, right):
        axes.grid(alpha=0.3, which="both")
    RESULTS.mkdir(parents=True, exist_ok=True)
    fig.savefig(RESULTS / "scaling.png", dpi=130)
    print(f"\npicture: {(RESULTS / 'scaling.png').relative_to(ROOT)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=100_000, help="largest chain")
    parser.add_argument("--scenes", action="store_true", help="the other scenes too")
    arguments = parser.parse_args()
    sizes = [n for n in (100, 1000, 10_000, 100_000, 1_000_000) if n <= arguments.largest]
    figures = {"chain": chain(sizes)}
    print_chain(figures["chain"])
    if arguments.scenes:
        figures["scenes"] = scenes()
    picture(figures["chain"])
    save("scaling", figures)


if __name__ == "__main__":
    main()
