"""Synthetic assemblies at the sizes of real ones, exact and watertight, the same bytes for the same seed."""
