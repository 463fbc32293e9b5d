"""A scene as an FMU: model description, sources, and a binary where there is a C compiler."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from lmoc.export.c_data import c_data
from lmoc.export.description import TYPES, build_description, model_description
from lmoc.export.executable import executable
from lmoc.messages.diagnostics import Diagnostic, ModelError
from lmoc.support import cache
from lmoc.support.records import dataclass
from lmoc.support.replacing import replace_file

if TYPE_CHECKING:
    from lmoc.dae import CompiledDAE
    from lmoc.view.drawing import Drawing

VERSIONS = (3, 2)
# as the engine itself is built (`compiler/building/lmoc_build.py`): equal bits everywhere
OPTIONS = ("-O2", "-std=c11", "-ffp-contract=off", "-fno-math-errno", "-fno-strict-aliasing", "-fvisibility=hidden")
_TOLERANCE = 1e-6
_ENGINE = (
    "tape", "blocks", "dense", "newton", "copies", "lu", "lu_order", "tables", "evaluate", "dop853", "walk", "instant",
    "relations", "trials", "roots", "crossing", "hops", "happen", "stiff_states", "first_step", "beside", "law_run",
    "transition", "strike", "jenkins", "switching", "mode", "project", "manifold", "impact", "impact_order",
    "complementarity", "cones", "free_dynamics", "jump", "landing",
)  # fmt: skip
_HEADERS = (
    "lane", "tape", "lu", "dense", "blocks", "newton", "copies", "tables", "engine", "walk", "instant", "roots", "hops",
    "happen", "beside", "law_run", "transition", "strike", "jenkins", "switching", "laws", "kinematics", "manifold",
    "impact",
    "complementarity", "free_dynamics", "jump", "landing",
)  # fmt: skip
_DATA = "model.c"


@dataclass(frozen=True)
class Exported:
    """An FMU that has been written.

    Attributes
    ----------
    path : Path
    binary : the platform that it has a binary for; empty for a source FMU
    compiler : the command that has made it
    fixed : names of parameters that cannot be set, since structure or start depend on them
    zero_inputs : {name: 0} of the inputs that the model leaves open: they begin with zero
    """

    path: Path
    binary: str
    compiler: str
    fixed: tuple[str, ...]
    zero_inputs: dict[str, float]


@dataclass(frozen=True)
class _Compiler:
    command: tuple[str, ...]
    system: str  # windows, linux, darwin
    machine: str  # x86_64, aarch64, x86

    @property
    def ending(self) -> str:
        return {"windows": ".dll", "darwin": ".dylib"}.get(self.system, ".so")

    def folder(self, fmi: int) -> str:
        """Return the name of the platform in an FMU."""
        if fmi == 3:
            return f"{self.machine}-{self.system}"
        bits = "32" if self.machine == "x86" else "64"
        return {"windows": "win", "darwin": "darwin"}.get(self.system, "linux") + bits


def export(
    dae: CompiledDAE, draw: Callable[[], Drawing], path: str | Path, fmi: int = 3, type: str | Sequence[str] = TYPES
) -> Exported:
    """Write a scene as an FMU.

    Parameters
    ----------
    draw : returns the picture of the scene, which becomes the icon
    path : .fmu
    fmi : 3 or 2
    type : "me" for Model Exchange, "cs" for Co-Simulation, or both

    Raises
    ------
    ModelError
        E0669: the scene cannot be exported, E0620: an argument is wrong, E0623: it cannot be written.
    """
    path, types = Path(path), (type,) if isinstance(type, str) else tuple(dict.fromkeys(type))
    _check(path, fmi, types)
    own = executable(dae)
    data, token = c_data(own, _TOLERANCE)
    identifier = _identifier(dae.name)
    texts = {**_sources(fmi), _DATA: data}
    names = sorted(n for n in texts if n.endswith(".c"))
    compiler = find_compiler()
    with tempfile.TemporaryDirectory(prefix="lmoc-fmu-") as folder:
        root = Path(folder)
        (root / "sources").mkdir()
        for name, text in texts.items():
            (root / "sources" / name).write_text(text, encoding="utf-8")
        description = model_description(own, fmi, types, identifier, token, names, _TOLERANCE)
        (root / "modelDescription.xml").write_text(description, encoding="utf-8")
        if fmi == 3:
            (root / "sources" / "buildDescription.xml").write_text(
                build_description(identifier, names, " ".join(OPTIONS)), encoding="utf-8"
            )
        _pictures(draw(), root, fmi)
        if compiler is not None:
            target = root / "binaries" / compiler.folder(fmi) / (identifier + compiler.ending)
            target.parent.mkdir(parents=True)
            _build(compiler, fmi, root / "sources" / _DATA, target)
        _write(path, root)
    command = "" if compiler is None else shlex.join(compiler.command)
    return Exported(path, "" if compiler is None else compiler.folder(fmi), command, own.held, own.zero_inputs)


def _check(path: Path, fmi: int, types: tuple[str, ...]) -> None:
    wrong = ""
    if fmi not in VERSIONS:
        wrong = f"there is no FMI {fmi} here: 3 and 2 are"
    elif not types or set(types) - set(TYPES):
        wrong = f"the type of an FMU is me, cs or both, not {', '.join(map(str, types)) or 'nothing'}"
    elif path.suffix != ".fmu":
        raise ModelError([Diagnostic("E0624", f"'{path}': an FMU has a name that ends in .fmu")])
    if wrong:
        raise ModelError([Diagnostic("E0620", wrong)])


def _identifier(name: str) -> str:
    """Return a name as a C identifier and a file can have it."""
    found = re.sub(r"\W", "_", name, flags=re.ASCII)
    return found if re.match(r"[A-Za-z_]", found) else f"scene_{found}"


def _sources(fmi: int) -> dict[str, str]:
    """Return the C files of an FMU that are the same for all scenes."""
    own, engine = Path(__file__).with_name("c"), Path(__file__).parents[1] / "engine" / "c"
    files = [engine / f"{n}.c" for n in _ENGINE] + [engine / f"{n}.h" for n in _HEADERS]
    parts = (
        "fmu_instances", "fmu", "fmu_steps", "fmu_branches", "fmu_hops", "discrete", "events", "fmu_laws", "jumps",
        "fmu_loops",
    )  # fmt: skip
    files += [own / f"{n}.c" for n in parts]
    files += [own / f"{n}.h" for n in ("fmu", "discrete", "fmu_laws", "fmu_loops", "fmi")] + [own / f"fmi{fmi}.c"]
    return {f.name: f.read_text(encoding="utf-8") for f in files}


def _apart(sources: dict[str, str], fmi: int) -> tuple[dict[str, str], dict[str, str]]:
    """Return the files that all versions of FMI share, and those with which the one of this version is compiled."""
    own = f"fmi{fmi}.c"
    shared = {name: text for name, text in sources.items() if name != own}
    return shared, {name: text for name, text in sources.items() if name == own or name.endswith(".h")}


def _pictures(drawing: Drawing, root: Path, fmi: int) -> None:
    folder = root / "terminalsAndIcons" if fmi == 3 else root
    folder.mkdir(exist_ok=True)
    name = "icon" if fmi == 3 else "model"
    drawing.save(folder / f"{name}.png")
    if fmi == 3:
        drawing.save(folder / f"{name}.svg")


def _write(path: Path, root: Path) -> None:
    """Zip a folder, with times that do not depend on when it was made."""

    def zipped(target: Path) -> None:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(p for p in root.rglob("*") if p.is_file()):
                information = zipfile.ZipInfo(file.relative_to(root).as_posix(), (1980, 1, 1, 0, 0, 0))
                information.compress_type = zipfile.ZIP_DEFLATED
                information.external_attr = 0o644 << 16
                archive.writestr(information, file.read_bytes())

    try:
        replace_file(path, zipped)
    except OSError as error:
        raise ModelError([Diagnostic("E0623", f"'{path}' cannot be written: {error.strerror}")]) from None


# ------------------------------------------------------------------------ binaries


def find_compiler() -> _Compiler | None:
    """Return the C compiler and what it compiles for: ``$LMOC_CC`` (empty: none wanted), else that of the machine.

    A ``-target`` in ``$LMOC_CC`` says what it compiles for, such as ``zig cc -target x86_64-windows-gnu``.
    """
    wanted = os.environ.get("LMOC_CC")
    if wanted is not None:
        command = tuple(shlex.split(wanted))
        return _for_target(command) if command and shutil.which(command[0]) else None
    found = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    if found is not None:
        return _for_target((found,))
    return _for_target((sys.executable, "-m", "ziglang", "cc")) if find_spec("ziglang") else None


def _for_target(command: tuple[str, ...]) -> _Compiler:
    machine, system = platform.machine().lower(), platform.system().lower()
    if "-target" in command[:-1]:
        machine, system = command[command.index("-target") + 1].split("-")[:2]
    machine = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}.get(machine, machine)
    return _Compiler(command, {"macos": "darwin"}.get(system.split(".")[0], system), machine)


def _build(compiler: _Compiler, fmi: int, data: Path, target: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="lmoc-fmu-") as folder:
        objects = []
        for name, content in _objects(compiler, fmi).items():
            objects.append(Path(folder) / name)
            objects[-1].write_bytes(content)
        shared = "-dynamiclib" if compiler.system == "darwin" else "-shared"
        libraries = [] if compiler.system == "windows" else ["-lm"]
        _run(compiler, [*OPTIONS, *_position(compiler), "-c", str(data), "-o", f"{folder}/data.o"])
        built = Path(folder) / target.name
        linked = [*map(str, objects), f"{folder}/data.o", "-o", str(built), *libraries]
        _run(compiler, [*_position(compiler), shared, *linked])
        shutil.copyfile(built, target)


@lru_cache(maxsize=4)
def _objects(compiler: _Compiler, fmi: int) -> dict[str, bytes]:
    """Return the engine, compiled: the same for all scenes, and so kept for the next process, too."""
    version = _version(compiler)
    shared, own = (_kept(compiler, version, sources) for sources in _apart(_sources(fmi), fmi))
    return shared | own


def _kept(compiler: _Compiler, version: str, sources: dict[str, str]) -> dict[str, bytes]:
    """Return the objects of C files, from the cache where they are there."""
    key = hashlib.sha256(repr((compiler, version, OPTIONS, sources)).encode()).digest()
    name = f"fmu-{key.hex()[:16]}"
    kept = cache.read(name, key)
    found: dict[str, bytes]
    if kept is not None:
        found = pickle.loads(kept)
        return found
    found = _compiled(compiler, sources)
    cache.write(name, key, pickle.dumps(found))
    cache.prune("fmu-", most=12)  # the engine and two versions of FMI for several systems
    return found


def _version(compiler: _Compiler) -> str:
    """Return what a compiler says of itself: after an upgrade it may have the same name and give other bits."""
    return subprocess.run([*compiler.command, "--version"], capture_output=True, text=True, errors="replace").stdout


def _compiled(compiler: _Compiler, sources: dict[str, str]) -> dict[str, bytes]:
    """Return the objects of C files by their names."""
    with tempfile.TemporaryDirectory(prefix="lmoc-fmu-") as folder:
        root = Path(folder)
        found = {}
        for name, text in sources.items():
            (root / name).write_text(text, encoding="utf-8")
        for source in sorted(root.glob("*.c")):
            made = source.with_suffix(".o")
            _run(compiler, [*OPTIONS, *_position(compiler), "-c", str(source), "-o", str(made)])
            found[made.name] = made.read_bytes()
        return found


def _position(compiler: _Compiler) -> list[str]:
    return [] if compiler.system == "windows" else ["-fPIC"]


def _run(compiler: _Compiler, arguments: list[str]) -> None:
    command = [*compiler.command, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        text = f"the C compiler has failed: {shlex.join(compiler.command)}"
        hint = "LMOC_CC names another one; with LMOC_CC= the FMU has sources only"
        raise ModelError([Diagnostic("E0623", text, found=done.stderr.strip()[:500], hint=hint)])
