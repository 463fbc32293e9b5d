"""Mutated models through the command: no traceback, nothing above 10 s of work, nothing above 1 GB.

``make fuzz``, or ``python tests/fuzz.py --count 20000 --jobs 2``. The seeds are the models, the library and the
programs in the tests. Case k is the same in every run with the same ``--seed``; a run that was interrupted goes on
where it stopped (``--fresh`` begins anew). Findings are kept in ``out/fuzz/`` with the program that shows them.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import json
import os
import random
import re
import resource
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "out" / "fuzz"
SECONDS, MEGABYTES = 10, 1000  # processor time, resident memory
_WALL = 6  # times as long on the clock before a case is taken for hanging
_LONGEST = 20_000  # characters of a seed
_VERBS = {  # what is done with a model, and how often
    ("run", "--stop", "1", "--points", "11"): 5,
    ("check",): 2,
    ("fmt", "--check"): 1,
    ("show", "--stage", "reduce"): 1,
    ("equations",): 1,
    ("equations", "--latex"): 1,
    ("equilibria",): 1,
    ("linearize",): 1,
    ("draw", "-o", "case.svg"): 1,
    ("draw", "--free-body", "-o", "case.svg"): 1,
    ("view", "--stop", "1", "-o", "case.html"): 1,
    ("run", "--stop", "1", "--points", "11", "--set", "{parameter}=0"): 1,
    ("equations", "--set", "{parameter}=0"): 1,
    ("study", "--sample", "{parameter}~uniform(0.5,2)", "--runs", "3", "--stop", "0.5", "--keep", "{variable}"): 1,
    ("fit", "--data", "measured.csv", "--free", "{parameter}", "--outputs", "x={variable}"): 1,
    ("export", "-o", "case.fmu"): 1,
}
_SCENE = """\
model Scene
  Fixed wall;
  Spring spring(k = 8);
  Damper damper(c = 1);
  Mass body(m = 2, q(start = 0.5, fixed = true));
equation
  connect(wall.flange, spring.a);
  connect(spring.b, body.flange);
  connect(wall.flange, damper.a);
  connect(damper.b, body.flange);
end Scene;
"""
_GOES_ON = "W0556", "W0563"  # a run that says how much is ahead may go on
_MEASURED = "time,x\n0,0\n0.1,0.01\n0.2,0.05\n0.4,0.1\n"
_TOKEN = re.compile(
    r'"(?:[^"\\]|\\.)*"|//[^\n]*|[A-Za-z_]\w*|\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|\s+|:=|<=|>=|==|<>|.', re.S
)
_PROGRAM = re.compile(r"\b(?:model|block|package|connector|record|function|type)\s+(\w+)\b.*?\bend\s+\1\s*;", re.S)
_ENDS = re.compile(r"[A-Za-z_]\w*(?:\[[^\]]*\])?\.[A-Za-z_]\w*")  # of connections: part.port
_DECLARED = re.compile(r"^\s*(?:(?:parameter|inner|outer|input|output|replaceable|final|constant)\s+)*[\w.]+\s+(\w+)")
_MODIFIED = re.compile(r"(\w+)\s*\(\s*(\w+)\s*=")  # part(parameter=…
_PARAMETER = re.compile(r"\bparameter\s+\w+\s*(?:\([^)]*\))?\s*(\w+)")
_NUMBERS = "0 1 -1 2 3 0.5 1e-3 1e3 1e-320 1e-308 1e12 1e308 1e400 100 65536 1000000 -0.0 3.14159".split()
_WORDS = """der pre edge change reinit when if then else elseif end for loop while equation algorithm initial model
    extends parameter constant input output flow each final redeclare replaceable inner outer connect time sin sqrt log
    min max abs sum size fill zeros ones noEvent smooth true false and or not protected import function record type
    enumeration = := + - * / ^ ( ) [ ] { } , ; : . <> < > <= >= == .* ./ .^ " // /* */ ' \\ \0 é 𝄞""".split()


@dataclass(frozen=True)
class Finding:
    """A case that went wrong."""

    case: int
    kind: str
    verb: str
    seconds: float
    megabytes: float
    said: str


# --------------------------------------------------------------------------- programs and their mutations


def seeds() -> list[str]:
    """All programs at hand, in a fixed order."""
    files = sorted([*ROOT.glob("models/*/*.lmo"), *ROOT.glob("stdlib/*.lmo"), *ROOT.glob("tests/wrong/*.lmo")])
    texts = [path.read_text(encoding="utf-8") for path in files]
    for path in sorted(ROOT.glob("tests/**/test_*.py")):
        texts += [match[0] for match in _PROGRAM.finditer(path.read_text(encoding="utf-8"))]
    return list(dict.fromkeys(t for t in texts if 20 < len(t) <= _LONGEST))


class Mutator:
    """Changes programs by tokens and by whole constructs; the constructs come from the syntax trees of the seeds."""

    def __init__(self, programs: list[str]) -> None:
        self.programs = programs
        self.tokens = [_TOKEN.findall(text) for text in programs]
        self.spans = [_constructs(text) for text in programs]
        self.pieces: dict[str, list[str]] = {}
        for text, spans in zip(programs, self.spans, strict=True):
            for kind, begin, end in spans:
                self.pieces.setdefault(kind, []).append(text[begin:end])

        self.models = [k for k, spans in enumerate(self.spans) if any(kind == "Connect" for kind, _, _ in spans)]

    def program(self, choose: random.Random) -> str:
        """One mutated program."""
        if choose.random() < 0.5:
            return self._by_parts(choose.choice(self.models), choose)
        k = choose.randrange(len(self.programs))
        if self.spans[k] and choose.random() < 0.5:
            text = self._by_tree(k, choose)
            return self._by_tokens(_TOKEN.findall(text), choose) if choose.random() < 0.15 else text
        return self._by_tokens(list(self.tokens[k]), choose)

    def _by_tree(self, k: int, choose: random.Random) -> str:
        """Expressions, equations and declarations are removed, doubled, exchanged, or replaced by those of others."""
        text, changes = self.programs[k], []
        for _ in range(choose.choice((1, 1, 1, 2, 3))):
            kind, begin, end = choose.choice(self.spans[k])
            if any(begin < e and b < end for b, e, _ in changes):
                continue
            own = text[begin:end]
            new = choose.choice(("", f"{own}{own}", *[choose.choice(self.pieces[kind])] * 6, f"({own})^({own})"))
            changes.append((begin, end, new))
        for begin, end, new in sorted(changes, reverse=True):
            text = text[:begin] + new + text[end:]
        return text

    def _by_parts(self, k: int, choose: random.Random) -> str:
        """Whole declarations and connections are exchanged with those of another model, whose parts may come along.

        A connection that is taken over is made to join parts that the program declares: what comes out is more often
        a scene than what `_by_tree` makes.
        """
        text, other = self.programs[k], choose.choice(self.models)
        parts = [(b, e) for kind, b, e in self.spans[k] if kind == "Component"]
        joints = [(b, e) for kind, b, e in self.spans[k] if kind == "Connect"]
        others = {
            want: [self.programs[other][b:e] for kind, b, e in self.spans[other] if kind == want]
            for want in ("Component", "Connect")
        }
        ends = _ENDS.findall(text)
        changes: list[tuple[int, int, str]] = []
        for _ in range(choose.choice((1, 1, 2, 3, 5))):
            kind = choose.choice(("Component", "Connect"))
            places = parts if kind == "Component" else joints
            if not places or not others[kind]:
                continue
            begin, end = choose.choice(places)
            if any(begin < e and b < end for b, e, _ in changes):
                continue
            new = self._joined(choose.choice(others[kind]), ends, choose) if kind == "Connect" else (
                self._renamed(text[begin:end], choose.choice(others[kind]), choose))  # fmt: skip
            action = choose.randrange(6)
            if action == 0:  # it comes along
                new = f"{text[begin:end]};\n  {new}"
            elif action == 1:  # two of the same program change places
                new = text[slice(*choose.choice(places))]
            elif action == 2:
                new = "" if kind == "Connect" else new
            changes.append((begin, end, new))
        for begin, end, new in sorted(changes, reverse=True):
            text = text[:begin] + new + text[end:]
        return text

    @staticmethod
    def _joined(connection: str, ends: list[str], choose: random.Random) -> str:
        """A connection of another program, of which one end or both are those of this one."""
        found = _ENDS.findall(connection)
        for old in choose.sample(found, choose.randint(1, len(found))) if found and ends else ():
            connection = connection.replace(old, choose.choice(ends))
        return connection

    @staticmethod
    def _renamed(own: str, new: str, choose: random.Random) -> str:
        """A declaration of another program, mostly by the name that the connections of this one know."""
        names = _DECLARED.search(own), _DECLARED.search(new)
        if None in names or choose.random() < 0.2:
            return new
        begin, end = names[1].span(1)
        return new[:begin] + names[0][1] + new[end:]

    def _by_tokens(self, tokens: list[str], choose: random.Random) -> str:
        for _ in range(choose.choice((1, 1, 1, 2, 2, 3, 5, 10))):
            if not tokens:
                break
            at = choose.randrange(len(tokens))
            other = choose.choice(self.tokens[choose.randrange(len(self.tokens))] or [";"])
            action = choose.randrange(10)
            if action < 2:
                del tokens[at]
            elif action == 2:
                tokens.insert(at, tokens[at])
            elif action == 3:
                tokens[at] = other
            elif action == 4:
                tokens.insert(at, f" {choose.choice(_WORDS)} ")
            elif action == 5:
                second = choose.randrange(len(tokens))
                tokens[at], tokens[second] = tokens[second], tokens[at]
            elif action == 6:
                self._change_number(tokens, choose)
            elif action == 7:
                names = [i for i, t in enumerate(tokens) if t[0].isalpha()]
                if names:
                    tokens[choose.choice(names)] = tokens[choose.choice(names)]
            elif action == 8:
                last = min(len(tokens), at + choose.randrange(1, 30))
                del tokens[at:last]
            else:
                last = min(len(tokens), at + choose.randrange(1, 60))
                tokens[at:at] = tokens[at:last] * choose.choice((1, 1, 2, 40))
        return "".join(tokens)

    @staticmethod
    def _change_number(tokens: list[str], choose: random.Random) -> None:
        numbers = [i for i, t in enumerate(tokens) if t[0].isdigit()]
        if numbers:
            tokens[choose.choice(numbers)] = choose.choice(_NUMBERS)


def _constructs(text: str) -> list[tuple[str, int, int]]:
    """Kind and place of all expressions, equations and declarations of a program; none where it is no program."""
    from lmoc.messages.diagnostics import ModelError, Report
    from lmoc.messages.source import Source
    from lmoc.syntax.node import walk
    from lmoc.syntax.parse import parse

    try:
        report = Report()
        file = parse(Source("seed.lmo", text), report)
        report.check()
    except ModelError:
        return []
    kinds = {"Number": "expression", "Ref": "expression", "Unary": "expression", "Binary": "expression",
             "Call": "expression", "If": "expression", "Array": "expression"}  # fmt: skip
    found = []
    for node in walk(file.classes):
        span, name = getattr(node, "span", None), type(node).__name__
        if span is not None and span.end > span.start:
            found.append((kinds.get(name, name), span.start, span.end))
    return found


def filled_in(verb: tuple[str, ...], text: str, choose: random.Random) -> tuple[str, ...]:
    """The words of a command, with names of the program where a parameter or a variable has to be named."""
    if not any("{" in word for word in verb):
        return verb
    parameters = [f"{part}.{name}" for part, name in _MODIFIED.findall(text)] + _PARAMETER.findall(text) or ["k"]
    variables = _ENDS.findall(text) or ["x"]
    names = {"{parameter}": choose.choice(parameters), "{variable}": choose.choice(variables)}
    for place, name in names.items():
        verb = tuple(word.replace(place, name) for word in verb)
    return verb


# --------------------------------------------------------------------------- one case, in a process of its own


def attempt(case: int, text: str, verb: tuple[str, ...], folder: Path) -> Finding | None:
    """Run the command on a program, watched; what went wrong, if anything did."""
    program, said = folder / "case.lmo", folder / "said.txt"
    program.write_text(text, encoding="utf-8", errors="replace")
    (folder / "measured.csv").write_text(_MEASURED)
    began, child = time.monotonic(), os.fork()
    if child == 0:
        _become_the_command([verb[0], str(program), *verb[1:]], said)
    status, usage = _wait(child, began + _WALL * SECONDS)
    seconds, megabytes = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    text = said.read_text(encoding="utf-8", errors="replace")
    kind = ""
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        kind = {signal.SIGXCPU: "slow", signal.SIGKILL: "hangs"}.get(number, f"signal {number}")
    elif os.WEXITSTATUS(status) not in (0, 1, 2, 3):
        kind = f"exit code {os.WEXITSTATUS(status)}"
    elif "Traceback" in text or "internal error" in text:
        kind = "traceback"
    elif megabytes > MEGABYTES:
        kind = "memory"
    elif seconds > SECONDS:
        kind = "slow"
    if kind == "slow" and ("goes on after" in text or any(f"warning[{code}]" in text for code in _GOES_ON)):
        kind = ""
    return Finding(case, kind, " ".join(verb), seconds, megabytes, text[-3000:]) if kind else None


def _wait(child: int, until: float) -> tuple[int, resource.struct_rusage]:
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            return status, usage
        if time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            return os.wait4(child, 0)[1:]
        time.sleep(0.002)


def _become_the_command(words: list[str], said: Path) -> None:
    """Never returns."""
    code = 99
    try:
        os.environ["LMOC_TRACEBACK"] = "1"
        os.environ["TMPDIR"] = str(said.parent)
        os.environ["LMOC_BUDGET"] = str(0.8 * SECONDS)
        os.chdir(said.parent)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS + 1, SECONDS + 2))
        resource.setrlimit(resource.RLIMIT_DATA, (4 << 30, 4 << 30))  # well above, so that the peak is measured
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        descriptor = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        sys.stdout, sys.stderr = open(1, "w", encoding="utf-8"), open(2, "w", encoding="utf-8")
        from lmoc.cli.main import main

        code = main(words)
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        os.write(2, traceback.format_exc().encode())
    os._exit(code)


# --------------------------------------------------------------------------- many cases, in several workers


def _import_what_verbs_import(folder: Path) -> None:
    """Import once, and not in every case, what the commands import where they need it: nine tenths of a case's time.

    A process of its own runs every verb on a small scene and names what it has imported. Nothing else of it is kept, so
    that each case begins like a command of its own.
    """
    names = folder / "imported.txt"
    child = os.fork()
    if child == 0:
        program = folder / "case.lmo"
        program.write_text(_SCENE, encoding="utf-8")
        (folder / "measured.csv").write_text(_MEASURED)
        sys.stdout = sys.stderr = (folder / "said.txt").open("w")
        os.chdir(folder)
        from lmoc.cli.main import main

        code = 0
        for verb in _VERBS:
            words = [word.format(parameter="spring.k", variable="body.q") for word in verb]
            code = main([words[0], program.name, *words[1:]]) or code
        names.write_text("\n".join(sys.modules) if code == 0 else "")
        os._exit(code)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0:
        raise SystemExit(f"a verb fails on a scene that is right: {folder / 'said.txt'}")
    for name in names.read_text().splitlines():
        if name.partition(".")[0] not in ("__main__", "__mp_main__"):
            with contextlib.suppress(ImportError):  # names that modules put there for themselves
                importlib.import_module(name)


def work(job: int, cases: Iterator[int], seed: int, place: Path) -> None:
    """Take cases one after the other; a line of JSON for each finding, and the number of cases done."""
    from lmoc.sources import library

    folder = place / f"job{job}"
    folder.mkdir(parents=True, exist_ok=True)
    _import_what_verbs_import(folder)
    library.load()
    mutator = Mutator(seeds())
    gc.freeze()  # what all cases share is not looked through, and so not copied, in each of them
    verbs, weights = list(_VERBS), list(_VERBS.values())
    with (place / f"findings{job}.jsonl").open("a", encoding="utf-8") as findings:
        for case in cases:
            choose = random.Random(f"{seed}:{case}")
            text, verb = mutator.program(choose), choose.choices(verbs, weights)[0]
            found = attempt(case, text, filled_in(verb, text, choose), folder)
            if found is not None:
                (place / f"{case}.lmo").write_text(text, encoding="utf-8", errors="replace")
                findings.write(json.dumps(asdict(found)) + "\n")
                findings.flush()
            (place / f"done{job}").write_text(str(case))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=20_000, help="number of cases (20000)")
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side (2)")
    parser.add_argument("--seed", type=int, default=1, help="another number gives other cases (1)")
    parser.add_argument("--fresh", action="store_true", help="begin anew")
    parser.add_argument("--only", type=int, help="print one case, run it and say what it does")
    arguments = parser.parse_args()
    if arguments.only is not None:
        return _show(arguments.only, arguments.seed)
    place = PLACE / f"seed{arguments.seed}"
    if arguments.fresh and place.exists():
        for path in place.glob("*.*"):
            path.unlink()
        for path in place.glob("done*"):
            path.unlink()
    place.mkdir(parents=True, exist_ok=True)
    children = {}
    for job in range(arguments.jobs):
        done = _number(place / f"done{job}")
        first = job if done is None else done + arguments.jobs
        child = os.fork()
        if child == 0:
            try:
                work(job, iter(range(first, arguments.count, arguments.jobs)), arguments.seed, place)
            except KeyboardInterrupt:
                os._exit(130)
            except BaseException:
                import traceback

                traceback.print_exc()
                os._exit(1)
            os._exit(0)
        children[job] = child
    return _follow(children, place, arguments)


def _follow(children: dict[int, int], place: Path, arguments: argparse.Namespace) -> int:
    """Show the progress until all workers have ended, then what was found."""
    began, first = time.monotonic(), None
    failed = 0
    try:
        while children:
            time.sleep(2)
            for job, child in list(children.items()):
                ended, status = os.waitpid(child, os.WNOHANG)
                if ended:
                    failed |= status
                    del children[job]
            done = sum(
                0 if (n := _number(place / f"done{job}")) is None else n // arguments.jobs + 1
                for job in range(arguments.jobs)
            )
            first = done if first is None else first
            rate = (done - first) / (time.monotonic() - began)
            left = f"{(arguments.count - done) / rate / 60:.0f} min left" if rate > 0 else ""
            line = f"{done} of {arguments.count} cases, {len(_findings(place))} findings, {rate:.1f}/s {left}"
            print(f"\r{line:<78}", end="" if sys.stdout.isatty() else "\n", flush=True)
    except KeyboardInterrupt:
        print("\nstopped; the same command goes on from here")
        return 130
    found = _findings(place)
    print()
    for f in found:
        last = next((line for line in reversed(f.said.splitlines()) if line.strip()), "")
        print(f"case {f.case}: {f.kind} ({f.verb}; {f.seconds:.1f} s, {f.megabytes:.0f} MB) {last[:100]}")
    print(f"{len(found)} findings in {place}" if found else "no traceback, nothing slow, nothing large")
    return 1 if found or failed else 0


def _findings(place: Path) -> list[Finding]:
    lines = [line for path in sorted(place.glob("findings*.jsonl")) for line in path.read_text().splitlines()]
    return sorted((Finding(**json.loads(line)) for line in lines), key=lambda f: f.case)


def _number(path: Path) -> int | None:
    text = path.read_text() if path.exists() else ""
    return int(text) if text else None  # it may just be written


def _show(case: int, seed: int) -> int:
    choose = random.Random(f"{seed}:{case}")
    text, verb = Mutator(seeds()).program(choose), choose.choices(list(_VERBS), list(_VERBS.values()))[0]
    verb = filled_in(verb, text, choose)
    folder = PLACE / "only"
    folder.mkdir(parents=True, exist_ok=True)
    print(text)
    found = attempt(case, text, verb, folder)
    print(found.said if found else (folder / "said.txt").read_text())
    print(f"--- {' '.join(verb)}: {found.kind if found else 'fine'}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
