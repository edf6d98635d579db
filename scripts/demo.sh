#!/usr/bin/env bash
# From a fresh checkout to pictures: makes .venv, then runs nurbs-ooc demo. Arguments go to the command.
source "$(dirname "$0")/setup.sh"
setup_python
setup_drawing
exec nurbs-ooc demo "$@"
