"""All hard cases by name."""

from __future__ import annotations

from tests.hard.case import HardCase
from tests.hard.closed_surfaces import closed_surface_cases
from tests.hard.degenerate import DegenerateCase, degenerate_cases
from tests.hard.splines import spline_cases
from tests.hard.swept import swept_cases
from tests.hard.trimmed import trimmed_cases

ALL = (*closed_surface_cases(), *spline_cases(), *trimmed_cases(), *swept_cases())
CASES: dict[str, HardCase] = {case.name: case for case in ALL}
DEGENERATE: dict[str, DegenerateCase] = {case.name: case for case in degenerate_cases()}
