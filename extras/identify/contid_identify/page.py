"""The report as one page of HTML: numbers, and the errors of every stage as bars; no other file is needed."""

from __future__ import annotations

from html import escape

from contid_identify.delay_lag import JudgedStage
from contid_identify.printed import lines
from contid_identify.stages import IdentifiedMotion

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem }
pre { background: #f4f4f4; padding: 1rem; overflow-x: auto; font-size: 13px }
table { border-collapse: collapse } td { padding: .15rem .6rem; white-space: nowrap }
svg { display: block } .bar { fill: #2b6cb0 } .whisker { stroke: #222; stroke-width: 1.5 }
"""
#: Width of a bar of the greatest error [px].
_WIDTH = 420.0
_HEIGHT = 14.0


def page(found: IdentifiedMotion) -> str:
    """The page."""
    title = escape(f"{found.robot}: identified motion")
    parts = [
        "<!doctype html>", f"<html lang='en'><head><meta charset='utf-8'><title>{title}</title>",
        f"<style>{_STYLE}</style></head><body>", f"<h1>{title}</h1>",
        "<p>Errors on blocks of time that were kept out of the fits, with 95 % intervals.</p>",
    ]  # fmt: skip
    for axis in found.axes:
        if axis.answer is not None:
            parts += _chart(axis.name, axis.answer.stages, 1.0 / axis.per_unit, axis.unit)
    if found.tip is not None:
        parts += _chart("tip", found.tip.stages, 1e3, "mm")
    if found.body is not None:
        parts += _chart("body", found.body.stages, 1e3, "mm")
    parts += ["<h2>Report</h2>", f"<pre>{escape(chr(10).join(lines(found)))}</pre>", "</body></html>"]
    return "\n".join(parts) + "\n"


def _chart(name: str, stages: tuple[JudgedStage, ...], factor: float, unit: str) -> list[str]:
    most = max(stage.kept_out.high for stage in stages) or 1.0
    rows = []
    for stage in stages:
        value, low, high = (
            _WIDTH * each / most for each in (stage.kept_out.rmse, stage.kept_out.low, stage.kept_out.high)
        )
        middle = 0.5 * _HEIGHT
        rows.append(
            f"<tr><td>{escape(stage.name)}</td><td>"
            f"<svg width='{_WIDTH + 4:.0f}' height='{_HEIGHT:.0f}'>"
            f"<rect class='bar' width='{value:.1f}' height='{_HEIGHT:.0f}'/>"
            f"<line class='whisker' x1='{low:.1f}' x2='{high:.1f}' y1='{middle}' y2='{middle}'/></svg></td>"
            f"<td>{factor * stage.kept_out.rmse:.4g} {escape(unit)}</td></tr>"
        )
    return [f"<h2>{escape(name)}</h2>", "<table>", *rows, "</table>"]
