#!/usr/bin/env bash
# Runs servers.py with the package and the server of a build, without installing:  servers.sh BUILD SOURCE acceptance|split|steps
set -euo pipefail
build=$1 source=$2 what=$3
python=/usr/bin/python3  # Debian's, which has the packages that apt installs
for module in cffi numpy; do
  "$python" -c "import $module" 2>/dev/null || { echo "SKIPPED: python3 has no $module: ./run install python"; exit 77; }
done
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/ridgecast"
cp "$source"/client/python/ridgecast/*.py "$scratch/ridgecast/"
ln -s "$build/client/c/libridgecast.so.1" "$scratch/ridgecast/"
PYTHONPATH=$source/client/python PYTHONDONTWRITEBYTECODE=1 "$python" -c '
import pathlib, sys, make_wheel
folder = pathlib.Path(sys.argv[1])
(folder / "ridgecast/_binding.py").write_bytes(make_wheel.binding(folder))' "$scratch"
PYTHONPATH=$scratch "$python" "$source/tests/e2e/python/servers.py" "$build/bin/ridgecast-server" "$source/docker" "$what"
