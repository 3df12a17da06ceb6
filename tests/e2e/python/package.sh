#!/usr/bin/env bash
# Makes the wheel of what was built, installs it without an index into a fresh environment, and tests it there:  package.sh BUILD SOURCE VERSION
set -euo pipefail
build=$1 source=$2 version=$3
python=/usr/bin/python3  # Debian's, which has the packages that apt installs
for module in cffi numpy venv pip; do
  "$python" -c "import $module" 2>/dev/null || { echo "SKIPPED: python3 has no $module: ./run install python"; exit 77; }
done
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$python" "$source/client/python/make_wheel.py" "$build/client/c/libridgecast.so.1" "$build/bin/ridgecast-server" "$version" "$scratch/wheel"
"$python" -m venv --system-site-packages "$scratch/venv"
"$scratch/venv/bin/pip" install --quiet --no-index "$scratch"/wheel/*.whl
cd "$scratch"
# What is used after it was freed is not what it was.
PYTHONWARNINGS=error MALLOC_PERTURB_=85 venv/bin/python "$source/tests/e2e/python/test_package.py"
PYTHONWARNINGS=error MALLOC_PERTURB_=85 venv/bin/python "$source/tests/e2e/python/test_scan.py"
PYTHONWARNINGS=error venv/bin/python "$source/tests/e2e/python/test_grid.py"
MALLOC_PERTURB_=85 venv/bin/python "$source/tests/e2e/python/test_members.py" "$build/bin/python_member"
PYTHONWARNINGS=error venv/bin/python "$source/tests/e2e/python/test_drones.py"
venv/bin/python "$source/client/python/examples/drones.py" 200
if "$python" -c 'import matplotlib' 2>/dev/null; then
  mkdir pictures
  venv/bin/python "$source/tests/e2e/python/run_notebook.py" "$source/client/python/notebook.md" pictures
fi
if command -v mypy >/dev/null; then
  (cd "$scratch/venv/lib"/python3*/site-packages && mypy --strict --ignore-missing-imports --cache-dir "$scratch/mypy" ridgecast "$source/client/python/examples/drones.py" "$source/client/evaluation/report.py")
fi
