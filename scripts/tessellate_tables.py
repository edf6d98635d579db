"""The tables of ``bench_tessellate.py``: lines as rows come in, and the section of the docs."""

from __future__ import annotations

from typing import Any


def car_body_line(row: dict[str, Any]) -> str:
    """One row of the car body's table, in Markdown."""
    cells = [f"{row['deflection_mm']:g}", row["faces"], row["triangles"], f"{row['faces_per_s']:.0f}"]
    cells += [f"{row['two_threads']:.2f}×", f"{row['error_over_deflection']:.2f}", len(row["violations"])]
    return "| " + " | ".join(str(c) for c in cells) + " |"


CAR_BODY_HEAD = (
    "| car body, deflection mm | faces | triangles | faces/s, one core | two threads beside one "
    "| error / deflection | violations |\n|--:|--:|--:|--:|--:|--:|--:|"
)

HEAD = (
    f"{'model':28}{'defl/diag':>10} |{'faces/s':>9}{'ktri/s':>8}{'tri':>9}{'err/defl':>9}{'viol':>5}"
    f" |{'OCC f/s':>9}{'ktri/s':>8}{'tri':>9}{'err/defl':>9} |{'speed':>7}{'tri ratio':>10}{'equal err':>10}"
)


def line(row: dict[str, Any]) -> str:
    """One row of the printed table."""
    a, b = row["ours"], row["open_cascade"]
    cells = [f"{row['model'][:27]:28}{row['deflection_over_diagonal']:10.0e} |"]
    for side in (a, b):
        cells.append(f"{side['faces_per_s']:9.0f}{side['triangles_per_s'] / 1e3:8.0f}{side['triangles']:9d}")
        cells.append(f"{side['error_over_deflection']:9.2f}")
        cells.append(f"{len(a['violations']):5d} |" if side is a else " |")
    cells.append(f"{row['speedup']:6.1f}x{a['triangles'] / max(1, b['triangles']):10.2f}")
    cells.append(f"{row['ours_at_their_error']['triangles'] / max(1, b['triangles']):10.2f}")
    return "".join(cells)


MARKDOWN_HEAD = (
    "| model | faces | deflection / diagonal | faces/s, ours | theirs | faster | triangles, ours | theirs "
    "| ours/theirs | at equal measured error | error / deflection, ours | theirs | violations "
    "| certified/measured on smooth faces, median | largest | first call s, ours | theirs |\n|---|" + "--:|" * 16
)


def markdown(result: dict[str, Any]) -> str:
    """The rows as a Markdown table with the machine's line."""
    cpu = result["machine"]
    fresh = result["fresh_process"]
    lines = [f"{cpu['cpu']}, one of {cpu['cores']} cores, Python {cpu['python']}. First call in a fresh process with"]
    lines += [f"compiled kernels, imports included: {fresh['wall_s']:.1f} s wall, {fresh['cpu_s']:.1f} s CPU.", ""]
    lines.append(MARKDOWN_HEAD)
    for r in result["rows"]:
        a, b = r["ours"], r["open_cascade"]
        cells = [r["model"], a["faces"], f"{r['deflection_over_diagonal']:.0e}", f"{a['faces_per_s']:.0f}"]
        cells += [f"{b['faces_per_s']:.0f}", f"{r['speedup']:.1f}×", a["triangles"], b["triangles"]]
        equal = r["ours_at_their_error"]["triangles"]
        cells += [f"{n / max(1, b['triangles']):.2f}" for n in (a["triangles"], equal)]
        cells += [f"{a['error_over_deflection']:.2f}", f"{b['error_over_deflection']:.2f}", len(a["violations"])]
        cells += [f"{a['median_of_smooth'] or 0.0:.2f}", f"{a['largest_of_smooth'] or 0.0:.1f}"]
        cells += [f"{side['first_call_s']:.2f}" for side in (a, b)]
        lines.append("| " + " | ".join(str(c) for c in cells) + " |")
    samples = sum(r["ours"]["samples"] for r in result["rows"]) + sum(r["samples"] for r in result["car_body"])
    lines += ["", f"{samples:,} distances were measured on our meshes.", "", CAR_BODY_HEAD]
    return "\n".join([*lines, *map(car_body_line, result["car_body"])])
