"""Length units by the names that CAD files use."""

from __future__ import annotations

ASSUMED = "millimetre (assumed)"

UNITS_MM: dict[str, float] = {
    "nanometre": 1e-6,
    "micrometre": 1e-3,
    "micron": 1e-3,
    "millimetre": 1.0,
    "centimetre": 10.0,
    "decimetre": 100.0,
    "metre": 1e3,
    "kilometre": 1e6,
    "microinch": 25.4e-6,
    "mil": 25.4e-3,
    "inch": 25.4,
    "foot": 304.8,
    "mile": 1609344.0,
}
SHORT_NAMES = {
    "MM": "millimetre",
    "M": "metre",
    "KM": "kilometre",
    "CM": "centimetre",
    "UM": "micrometre",
    "IN": "inch",
    "INCH": "inch",
    "FT": "foot",
    "MI": "mile",
    "MIL": "mil",
    "UIN": "microinch",
}


def named_unit(name: str) -> tuple[str, float]:
    """Normalised name and size in mm; what is not known counts as mm and says so."""
    plain = name.strip().lower().replace("meter", "metre").rstrip(".").removesuffix("s")
    plain = SHORT_NAMES.get(name.strip().upper(), "foot" if plain == "feet" else plain)
    return (plain, UNITS_MM[plain]) if plain in UNITS_MM else (ASSUMED, 1.0)
