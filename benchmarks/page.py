"""Pages in a real browser: size, first frame, complaints, and frames of a hundred parts that run and are dragged.

    python benchmarks/page.py [FILE …]      all models without files
    python benchmarks/page.py frames        the hundred parts alone

The frames are those of Chromium's headless window, at 60 a second at most. Beside them stands what the page's thread
works for a frame, which no other load changes: below 16 ms it is ready for the next one.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from oracles.browser import browser, in_page, open_page  # noqa: E402

import lmoc  # noqa: E402

LARGEST, LATEST = 1_500_000, 1000  # bytes, ms
FRAMES = 120
FACTS = """
const painted = () => performance.getEntriesByType("paint").find((e) => e.name === "first-contentful-paint");
for (let k = 0; k < 600 && !painted(); k++) await frames(1);
return { first: painted()?.startTime ?? 1e9, requests: performance.getEntriesByType("resource").length,
         wide: document.documentElement.scrollWidth > innerWidth, sliders: document.querySelectorAll(".slider").length,
         hint: document.getElementById("hint").textContent };
"""
CHAIN = """
model Chain "A chain of 100 masses"
  parameter Integer n = 100;
  Fixed wall;
  Mass m[n](each m = 0.1, each q(start = 0, fixed = true), v(start = {0.01*i for i in 1:n}, each fixed = true));
  SpringDamper s[n](each k = 400, each c = 0.05);
equation
  connect(wall.flange, s[1].a);
  for i in 1:n loop connect(s[i].b, m[i].flange); end for;
  for i in 2:n loop connect(m[i - 1].flange, s[i].a); end for;
  annotation(experiment(StopTime = 20));
end Chain;
"""
PENDULUM = """
model Chains "Twenty pendulums of five springs and masses each"
  inner Planar.World world(g = 9.81);
  Planar.Anchor nail[20](x = {0.2*k for k in 1:20}, each y = 0);
  Planar.PointMass ball[20](each m = 0.2, x(start = {0.2*k + 0.05 for k in 1:20}, each fixed = true),
    y(start = {-0.5 for k in 1:20}, each fixed = true), each vx(start = 0, fixed = true),
    each vy(start = 0, fixed = true));
  Planar.Spring spring[20](each k = 30, each d0 = 0.4);
  Planar.Spring tie[19](each k = 2, each d0 = 0.2);
  Planar.Damper damper[19](each c = 0.02);
equation
  for k in 1:20 loop connect(nail[k].point, spring[k].a); connect(spring[k].b, ball[k].point); end for;
  for k in 1:19 loop
    connect(ball[k].point, tie[k].a); connect(tie[k].b, ball[k + 1].point);
    connect(ball[k].point, damper[k].a); connect(damper[k].b, ball[k + 1].point);
  end for;
  annotation(experiment(StopTime = 20));
end Chains;
"""
READY = """
const svg = document.querySelector("#stage svg");
const box = document.querySelector("SELECTOR").getBoundingClientRect();
svg.setPointerCapture = () => {};
const [x, y] = [box.left + box.width / 2, box.top + box.height / 2];
const send = (type, k) => svg.dispatchEvent(new PointerEvent(type, { bubbles: true, clientX: x + 20 * Math.sin(k / 9),
  clientY: y + 6 * Math.sin(k / 5), button: 0, buttons: 1, pointerId: 1 }));
if (PLAYS) document.getElementById("play").click();
await frames(5);
if (DRAGS) {
  send("pointerdown", 0);
  send("pointermove", 9);
}
window.measured = async (count) => {
  let [shown, before, times] = [0, "", []];
  const watched = [...svg.querySelectorAll(".item .line")];
  const look = () => watched.map((e) => e.getAttribute("d") ?? e.getAttribute("points") ?? e.getAttribute("cx")).join();
  for (let k = 0; k < count; k++) {
    if (DRAGS) send("pointermove", k);
    times.push(await new Promise(requestAnimationFrame));
    if (k % 10 === 9) {
      const now = look();
      shown += 10 * (now !== before);
      before = now;
    }
  }
  const gaps = times.slice(1).map((t, k) => t - times[k]).sort((a, b) => a - b);
  const rate = 1000 * gaps.length / (times.at(-1) - times[0]);
  return { items: document.querySelectorAll("#stage .item").length, rate, worst: gaps.at(-1), changed: shown / count };
};
await frames(20);
"""
MODES = {"dragged at rest": (False, True), "dragged while running": (True, True), "running": (True, False)}


def worked() -> float:
    """Return the seconds that the thread of the page has worked."""
    metrics = browser().command("Performance.getMetrics")["metrics"]
    return next(m["value"] for m in metrics if m["name"] == "TaskDuration")


def followed(html: str, selector: str, plays: bool, drags: bool) -> str:
    """Let a scene run, or drag what a selector finds, and tell how the page follows."""
    browser().command("Performance.enable", timeDomain="threadTicks")
    script = READY.replace("SELECTOR", selector)
    open_page(html, script.replace("PLAYS", str(plays).lower()).replace("DRAGS", str(drags).lower()))
    before = worked()
    found = in_page(f"return await window.measured({FRAMES});")
    work = (worked() - before) / FRAMES
    return (
        f"{found['rate']:.0f} frames a second, the longest {found['worst']:.0f} ms, {1000 * work:.1f} ms of work each; "
        f"{found['items']} items, anew in {found['changed']:.0%} of the frames"
    )


def opened(path: Path) -> bool:
    """Print what the page of a model is like, and return whether that is as it should be."""
    try:
        html = lmoc.compile(path).simulate().view().html
    except (lmoc.ModelError, lmoc.SimulationError) as error:
        print(f"{path.parent.name}/{path.stem}: {str(error).splitlines()[0]}", flush=True)
        return True
    seen = open_page(html, FACTS)
    own = seen.answer
    bad = seen.console or own["requests"] or own["wide"] or len(html) > LARGEST or not own["first"] < LATEST
    size, hint = f"{len(html) / 1e6:.2f} MB", f" {own['hint']}" * bool(own["hint"])
    facts = f"{size}, first frame {own['first']:.0f} ms, {own['sliders']} sliders{hint}"
    print(f"{path.parent.name}/{path.stem}: {facts}{f' WRONG {seen.console} {own}' * bool(bad)}", flush=True)
    return not bad


def main(files: list[str]) -> int:
    """Print a line for each page; the number of pages that are not as they should be is the exit code."""
    warnings.simplefilter("ignore")
    every = sorted(p for p in (ROOT / "models").rglob("*.lmo") if "failures" not in p.parts)
    paths = [] if files == ["frames"] else [Path(file) for file in files] or every
    wrong = sum(not opened(path) for path in paths)
    if files in ([], ["frames"]):
        for name, text, selector in (
            ("chain", CHAIN, "#stage .mass .line"),
            ("plane", PENDULUM, "#stage .particle circle"),
        ):
            html = lmoc.compile_text(text).simulate().view().html
            for mode, own in MODES.items():
                print(f"{name}, {mode}: {followed(html, selector, *own)}", flush=True)
    return wrong


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
