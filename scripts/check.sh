#!/usr/bin/env bash
# Format, lint, strict types and the direction of imports. Runs all four, fails if one does.
source "$(dirname "$0")/setup.sh"
setup_python dev
status=0
ruff format --check . || status=1
ruff check . || status=1
mypy || status=1
lint-imports || status=1
exit $status
