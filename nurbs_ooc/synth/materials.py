"""The materials of the models: 9 of a small car, 24 of a larger one. Roles that a small car lacks borrow another's."""

from __future__ import annotations

from nurbs_cache.scene_record import Material

Colour = tuple[float, float, float]

SMALL: dict[str, Colour] = {
    "paint": (0.02, 0.07, 0.26),
    "glass": (0.03, 0.05, 0.06),
    "rubber": (0.012, 0.012, 0.013),
    "alloy": (0.52, 0.53, 0.55),
    "plastic": (0.03, 0.03, 0.033),
    "steel": (0.30, 0.31, 0.33),
    "red lens": (0.16, 0.002, 0.006),
    "clear lens": (0.60, 0.63, 0.66),
    "fabric": (0.10, 0.10, 0.12),
}
MORE: dict[str, Colour] = {
    "leather": (0.16, 0.10, 0.06),
    "wood": (0.14, 0.05, 0.02),
    "carpet": (0.05, 0.05, 0.05),
    "cast aluminium": (0.40, 0.40, 0.39),
    "zinc": (0.36, 0.38, 0.40),
    "cast iron": (0.11, 0.10, 0.10),
    "engine black": (0.018, 0.018, 0.02),
    "copper": (0.50, 0.20, 0.09),
    "amber lens": (0.70, 0.22, 0.01),
    "chrome": (0.75, 0.76, 0.78),
    "mirror glass": (0.25, 0.28, 0.30),
    "plate white": (0.78, 0.78, 0.76),
    "seal": (0.008, 0.008, 0.008),
    "headliner": (0.42, 0.40, 0.36),
    "underbody": (0.02, 0.022, 0.022),
}
BORROWED: dict[str, str] = {
    "leather": "fabric",
    "wood": "plastic",
    "carpet": "fabric",
    "cast aluminium": "alloy",
    "zinc": "steel",
    "cast iron": "steel",
    "engine black": "plastic",
    "copper": "steel",
    "amber lens": "red lens",
    "chrome": "alloy",
    "mirror glass": "glass",
    "plate white": "clear lens",
    "seal": "rubber",
    "headliner": "fabric",
    "underbody": "rubber",
}


def material_list(n: int, paint: Colour) -> tuple[list[Material], dict[str, int]]:
    """The ``n`` (9 or 24) materials of a car, and the row of every role."""
    colours = {**SMALL, **MORE} if n > len(SMALL) else dict(SMALL)
    assert len(colours) == n, n
    colours["paint"] = paint
    rows = {name: row for row, name in enumerate(colours)}
    roles = {role: rows.get(role, rows.get(BORROWED.get(role, role), 0)) for role in {**SMALL, **MORE}}
    return [Material(name, (*colour, 1.0)) for name, colour in colours.items()], roles
