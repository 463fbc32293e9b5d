"""Trees of files of packages hold what is read of annotations, and nothing else is lost."""

import re
from pathlib import Path

import lmoc.semantics
from lmoc.messages.diagnostics import Report
from lmoc.messages.source import Source
from lmoc.sources.lean import ENTRIES, lean
from lmoc.syntax import tree
from lmoc.syntax.node import alike
from lmoc.syntax.parse import parse

WHOLE = """
package P
  model M
    extends B annotation(Placement(x = 1));
    parameter Real k = 2 annotation(Dialog(tab = "a"), Slider(max = 3));
    Real x annotation(HideResult = true);
    function f input Real u; output Real y; algorithm y := u; annotation(derivative = df, Inline = true); end f;
  equation
    x = k annotation(Line(y = 2));
    connect(a, b) annotation(Line(y = 2));
  annotation(experiment(StopTime = 3), Documentation(info = "long"), Icon(graphics = {}), __lmoc(symbol = "mass"));
  end M;
  annotation(Documentation(info = "long"));
end P;
"""
READ = """
package P
  model M
    extends B;
    parameter Real k = 2 annotation(Slider(max = 3));
    Real x;
    function f input Real u; output Real y; algorithm y := u; annotation(derivative = df); end f;
  equation
    x = k;
    connect(a, b);
  annotation(experiment(StopTime = 3), Icon(graphics = {}), __lmoc(symbol = "mass"));
  end M;
end P;
"""


def tree_of(text: str) -> tree.File:
    report = Report()
    found = parse(Source("p.mo", text), report)
    report.check()
    return found


def test_what_nobody_reads_is_left_out() -> None:
    assert alike(lean(tree_of(WHOLE)), tree_of(READ))
    assert alike(lean(tree_of(READ)), tree_of(READ))


def test_every_entry_that_is_read_is_kept() -> None:
    text = "".join(p.read_text("utf-8") for p in Path(lmoc.semantics.__file__).parent.rglob("*.py"))
    asked = re.findall(r"""entry_of\(\S*annotation, "(\w+)"\)""", text)
    asked += re.findall(r"""\.name [!=]= \("(\w+)",\)""", text)
    assert {"Icon", "Slider", "experiment", "derivative", "__lmoc"} <= set(asked) <= ENTRIES
