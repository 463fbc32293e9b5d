"""Runs repeated by JavaScript, beside those of Python."""

import json
from base64 import b64decode, b64encode
from dataclasses import dataclass
from zlib import decompress

import numpy as np
from oracles.node import run_script

from lmoc.view.javascript.script import Script
from lmoc.view.page.join import engine, joined

ROUNDING = 1e-9  # of the largest value of all: where all of a unit are smaller, terms cancel in them


@dataclass
class Repeated:
    """A run of JavaScript beside that of Python."""

    names: list[str]
    values: np.ndarray  # (times, names)
    complete: bool
    reason: str
    steps: int
    events: list[dict]
    changes: list[float]  # s, of coordinates


def in_engine(module: str) -> str:
    """A module, and the engine compiled."""
    text = b64encode(decompress(b64decode(engine()))).decode()
    return f'{joined(module)}\nconst engine = new WebAssembly.Module(decodeBytes("{text}"));'


def program(script: Script, body: str) -> str:
    """A script of its own around a scene."""
    return f"{{ const scene = new Scene({json.dumps(script.data, allow_nan=False)}, engine);\n{body}\n}}"


def repeat(cases: list[tuple[object, Script, list[list[float]]]]) -> list[Repeated]:
    """Repeat runs in one process: (run of Python, its script, changed values) each."""
    parts, names = [], []
    for run, script, changed in cases:
        variables = run.table_variables()
        variables = variables[script.registers[variables] >= 0]
        wanted = script.registers[variables].tolist()
        names.append([run.flat.variable_name(int(v)) for v in variables])
        begun = f"const run = new Run(scene, {json.dumps(run.time.tolist())}, {json.dumps(wanted)}, {{}});"
        result = f"{{ ...run.go({json.dumps(changed)}), changes: [...run.tried].map(parseFloat) }}"
        body = f"{begun}\nconst r = {result};\nr.columns = r.columns.map((c) => [...c]);\nout.push(r);"
        parts.append(program(script, body))
    text = "\n".join([in_engine("repeat.js"), "const out = [];", *parts])
    found = run_script(text + "\nconsole.log(JSON.stringify(out));")
    told = "complete", "reason", "steps", "events", "changes"
    return [
        Repeated(own, np.array(r["columns"], float).T, *(r[name] for name in told))
        for own, r in zip(names, found, strict=True)
    ]


def difference(run, repeated: Repeated) -> float:
    """The largest difference by the largest value of the same unit."""
    truth = run.values(np.concatenate([run.flat.find(name) for name in repeated.names]))
    assert (np.isnan(truth) == np.isnan(repeated.values)).all()
    units = np.array([run.unit(name) for name in repeated.names])
    top = np.nanmax(np.abs(truth), axis=0, initial=0.0)
    missed = np.nan_to_num(np.abs(truth - repeated.values)).max(axis=0)
    least = ROUNDING * float(top.max(initial=0.0)) or 1.0
    return max(float(missed[units == u].max()) / max(float(top[units == u].max()), least) for u in set(units.tolist()))
