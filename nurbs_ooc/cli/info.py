"""``nurbs-ooc info``: what is in a cache."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from nurbs_ooc.cli.console import Console, run_command


@click.command()
@click.argument("cache", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print one line of JSON.")
@run_command
def command(cache: Path, as_json: bool) -> None:
    """Show what is in CACHE: units, products, surfaces, levels, nodes, bytes, and how the faces came through.

    ``content_hash`` is equal for equal content, however and wherever it was built. Lengths are millimetres.
    """
    from nurbs_cache.store import Store
    from nurbs_ooc.build.report import contents

    console = Console(as_json)
    with Store.open(cache) as store:
        found = {"content_hash": store.content_hash(), **contents(store)}
        tree = _product_lines(store.get_products())
        materials = [f"{m.name} {tuple(round(c, 3) for c in m.rgba)}" for m in store.get_materials()]
    console.json(found)
    for line in _lines(found):
        console.print(line)
    console.print("products:", *("\n  " + line for line in tree))
    console.print("materials:", *("\n  " + line for line in materials))


def _lines(found: dict[str, Any]) -> list[str]:
    """The report for people, nested values as ``name: key value, key value``."""
    lines = []
    for name, value in found.items():
        if isinstance(value, dict):
            value = ", ".join(f"{key} {entry}" for key, entry in value.items())
        lines.append(f"{name}: {value}")
    return lines


def _product_lines(products: list[Any]) -> list[str]:
    """Names indented by their depth; parents come before their children, so depths are known in order."""
    depths: list[int] = []
    for product in products:
        depths.append(depths[product.parent] + 1 if product.parent >= 0 else 0)
    return ["  " * depth + product.name for depth, product in zip(depths, products, strict=True)]
