#!/usr/bin/env bash
# scripts/test.sh [--all] [pytest arguments]
# The default suite, then the kernel tests once as plain Python and once with array bounds checked. --all adds
# the long tests. Real models: NURBS_OOC_DATA names their folder. With pytest arguments only those are run.
source "$(dirname "$0")/setup.sh"
setup_python test
setup_drawing

marks="not long"
if [ "${1:-}" = --all ]; then
    marks=""
    shift
fi
python -m pytest -m "$marks" "$@"
[ $# = 0 ] || exit 0

echo "kernel tests as plain Python"
NUMBA_DISABLE_JIT=1 python -m pytest -q -m "kernel and not long"
echo "kernel tests with array bounds checked"
# numba keys its machine code by source, not by this flag: it needs a folder of its own; and unoptimised, for
# it is compiled for this one run
NUMBA_BOUNDSCHECK=1 NUMBA_OPT=0 NURBS_OOC_KERNEL_CACHE="$venv/kernels-checked" \
    python -m pytest -q -m "kernel and not long" -W "ignore:Cannot cache compiled function"
