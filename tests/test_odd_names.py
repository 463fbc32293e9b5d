"""Every name that the language allows works in every verb and format, and is read as a text by whoever shows it."""

import json
import re

import numpy as np
import pytest

import lmoc
from lmoc.cli.main import main
from lmoc.support.quoted import last, parent, partition, split, subscripts, with_subscripts, without_subscripts

NAMES = """a.b|a:b|a[1]|a b|$x$|#1 50%|$\\input{/etc/passwd}$|<b>x</b>|&amp;|x"y|it\\'s|{x}|a,b|a=b|ä|☃|𝄞|x_1|x^2|-1
der(x)|time|..|`rm -r`|$(ls)|%s {0}|__proto__|</script>|[1]|a].b|~|\\\\|true|"""
ODD = [name for line in NAMES.splitlines() for name in line.split("|") if name]
TOGETHER = [
    "a.b:c[1],d=e der(x)..",
    r"$\input{/etc/passwd}$ #1 50% & x_1^2 ~ `rm -r` $(ls) %s {0}",
    r"</script><b>x</b> \"y\" it\'s ä☃𝄞 __proto__ &amp;",
]
SCENE = """model '@' "a $scene$ of @"
  Fixed w; Spring s(k = 10); Mass '@'(m = 2, q(start = 0.1, fixed = true)); Force '@f'; input Real '@u' = 0.1;
  parameter Real '@p' = 1 "parameter \\\\input{x} $"; output Real '@o' = '@'.q*'@p';
equation
  connect(w.flange, s.a); connect(s.b, '@'.flange); connect('@f'.flange, '@'.flange); '@f'.f = '@u';
end '@';
"""


def scene(name: str) -> str:
    text = SCENE.replace("@", name)
    return text.replace(f'of {name}"', 'of a name"')  # in a description a quote has a meaning


def test_there_are_enough_of_them():
    assert len(ODD) >= 29 and len(set(ODD)) == len(ODD)


@pytest.mark.parametrize("name", ODD)
def test_in_python(name):
    dae = lmoc.compile_text(scene(name))
    part, own, gain, push = (f"'{name}{end}'" for end in ("", "o", "p", "u"))
    run = dae.simulate(stop=1, points=5, parameters={gain: 2.0}, inputs={push: 0.0}, initial={f"{part}.v": 1.0})
    assert np.array_equal(run[own], 2 * run[f"{part}.q"]) and run[f"{part}.v"][0] == 1
    assert f"{part}.q" in dae.states and dae.inputs == [push] and dae.outputs == [own] and gain in dae.parameters
    assert own in run.to_dataframe().columns
    assert len(dae.sweep({gain: [1.0, 2.0]}, options={"stop": 1, "points": 3})) == 2
    live = dae.live()
    live.inputs[push] = 1.0
    live.advance(0.1)
    assert live[own] == live[f"{part}.q"]
    assert f"{part}.q" in dae.symbolic_ode()
    static = 1 / 10
    assert dae.transfer_function(push, f"{part}.q").gain == pytest.approx(static)
    with pytest.raises(KeyError, match=re.escape(name)):
        run[f"'{name}?'.q"]


FORMATS = {  # verb and options
    "tables": [["run", "-o", "r.csv", "--json", "--init", "'@'.q=0.3", "--input", "'@u'=0.2", "--keep", "'@'.q"]],
    "arrays": [["run", "-o", "r.npz", "--events"], ["run", "-o", "r.mat", "--quiet"]],
    "pictures": [["run", "--plot", "p.svg", "--show", "'@'.q,'@o'"], ["run", "--set", "'@p'=1:1:2", "--plot", "s.svg"]],
    "portraits": [["run", "--phase", "f.svg", "--spectrum", "g.svg"]],
    "modes": [["linearize", "--plot", "l.svg", "--output", "'@o'"]],
    "stages": [["check"], ["show", "--stage", "parse"], ["show", "--stage", "flatten"], ["show", "--stage", "lower"]],
    "formulas": [["equations"], ["equations", "--json"], ["equations", "--html"], ["equations", "--with-forces"]],
    "rest": [["equilibria", "--input", "'@u'=2"], ["linearize", "--symbolic"], ["equivalent", "'@'.flange"]],
    "transfer": [["transfer", "'@u'", "'@'.q"], ["transfer", "'@u'", "'@o'", "--latex"]],
    "drawings": [["draw", "-o", "d.svg"], ["draw", "--free-body", "-o", "b.svg"], ["view", "-o", "v.html"]],
    "comparison": [["compare", "m.lmo", "--show", "'@o'", "--stop", "0.1"]],
}
QUICK = {"run": ["--stop", "0.2", "--points", "5"], "view": ["--stop", "0.2"]}


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("name", TOGETHER)
def test_in_every_verb(name, kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.lmo").write_text(scene(name), encoding="utf-8")
    for verb, *options in FORMATS[kind]:
        words = [verb, "m.lmo", *(word.replace("@", name) for word in options), *QUICK.get(verb, [])]
        assert main(words) == 0, (words, capsys.readouterr().err)
    if kind == "tables":
        assert json.loads(capsys.readouterr().out)["model"] == f"'{name}'"
        head = (tmp_path / "r.csv").read_text(encoding="utf-8").partition("\n")[0]
        assert f"'{name}'.q".replace('"', '""') in head or f"'{name}'.q" in head
    if kind == "arrays":
        assert f"'{name}'.q" in np.load("r.npz")
    if kind == "drawings":
        assert "<b>x" not in (tmp_path / "d.svg").read_text("utf-8") + (tmp_path / "v.html").read_text("utf-8")


@pytest.mark.parametrize("name", ODD)
def test_nothing_in_a_name_is_a_command_of_latex(name):
    dae = lmoc.compile_text(scene(name))
    for text in (dae.equations().latex(), dae.transfer_function(f"'{name}u'", f"'{name}o'")._repr_latex_()):
        assert set(re.findall(r"\\([a-zA-Z]+)", text)) <= {
            "begin", "end", "ddot", "dot", "frac", "left", "right", "mathrm", "mathit", "text", "displaystyle",
            "textbackslash", "textasciicircum", "textasciitilde", "textless", "textgreater", "textasciigrave",
            "textquotedbl",
        }  # fmt: skip
        assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
        outside = text.removeprefix("$").removesuffix("$")
        assert not re.search(r"(?<!\\)[#%$]", outside) and not re.search(r"(?<!\\)&(?!=)", outside)


def test_latex_of_modes_holds_no_commands_of_names():
    text = r"""model M Mass '\input{x}'(m = 1, q(start = 1, fixed = true), v(start = -1, fixed = true)); Fixed w;
    Stop '$stop$'(L = 0, e = 0.5); equation connect(w.flange, '$stop$'.a); connect('$stop$'.b, '\input{x}'.flange);
    end M;"""
    found = lmoc.compile_text(text).equations().latex()
    assert r"\input" not in found and not re.search(r"(?<!\\)\$", found)


def test_names_are_split_outside_of_quotes():
    name = r"m[3].'a.b[1]\'c.'[1,2].q"
    assert split(name) == ["m[3]", r"'a.b[1]\'c.'[1,2]", "q"] and last(name) == "q"
    assert parent(name) == r"m[3].'a.b[1]\'c.'[1,2]" and parent("q") == ""
    assert without_subscripts(name) == r"m.'a.b[1]\'c.'.q" and without_subscripts("a[1].b", "[]") == "a[].b"
    assert subscripts(name) == [["3"], ["1", "2"]] and with_subscripts(name, "789") == r"m[7].'a.b[1]\'c.'[8,9].q"
    assert partition("'a=b'=2=3", "=") == ("'a=b'", "=", "2=3") and partition("'a=b'", "=") == ("'a=b'", "", "")
    assert split("it's.an 'odd") == ["it's", "an 'odd"] or split("it's.an 'odd") == ["it's.an 'odd"]


def test_no_sign_of_a_name_commands_a_terminal(tmp_path, capsys, monkeypatch):
    """Messages show what is no letter as a dot; standard output does where it is a terminal, a file has it as it is."""
    name = "'\x1b[2J'"
    file = tmp_path / "a\x1b[31mb.lmo"
    file.write_text(f"model M Real {name}; end M;")
    assert main(["check", str(file)]) == 1
    said = capsys.readouterr().err
    assert "\x1b" not in said and "'·[2J'" in said
    for words in (["run", "m.lmo", "--set", f"{name}=1"], ["run", "m.lmo", "--\x9b2J"], ["\x1b[2J"]):
        assert main(words) in (1, 2)
        assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f]", capsys.readouterr().err)
    file.write_text(f"model M Real {name}(start = 1, fixed = true); equation der({name}) = -{name}; end M;")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    assert main(["run", str(file), "--stop", "1"]) == 0
    shown = re.sub(r"\x1b\[[\d;]*m", "", capsys.readouterr().out)  # but for the command's own colours
    assert "\x1b" not in shown and "'·[2J'" in shown
