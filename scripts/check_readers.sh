#!/usr/bin/env bash
# The tables of a run in, what every common reader of Parquet makes of them out; skipped, with a line that says why, where there is no
# Python with pip. See check_readers.py.
set -euo pipefail
if ! python3 -m pip --version >/dev/null 2>&1; then
    echo "skipped: python3 with pip is needed to open the tables with other readers"
    exit 0
fi
exec python3 "$(dirname "$0")/check_readers.py" "$@"
