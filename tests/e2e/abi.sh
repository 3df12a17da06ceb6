#!/usr/bin/env bash
# Compares the C interface with the one that was promised, client/c/ridgecast.abi, and the library's functions with its header's.
#   abi.sh LIBRARY SOURCE [write]     write: promises what is there now
set -euo pipefail
library=$1 folder=$2/client/c how=${3:-}
command -v abidiff >/dev/null || { echo "SKIPPED: there is no abidiff: ./run install test"; exit 77; }
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# The header's functions as a library of their own: no type of ours shows behind its opaque handles.
{
  sed '/^#ifdef __cplusplus/,$d' "$folder/ridgecast.h"
  echo '#ifdef __cplusplus'
  sed '1,/^#ifdef __cplusplus/d' "$folder/ridgecast.h" | sed -E 's/^((const )?[a-z_0-9]+\*? \*?rc_[a-z_]+\(.*\));/\1 { __builtin_trap(); }/; s/^( +.*\));/\1 { __builtin_trap(); }/'
} >"$scratch/ridgecast.c"
gcc -std=c11 -g -shared -fPIC -o "$scratch/libridgecast.so.1" "$scratch/ridgecast.c"
symbols() { nm -D --defined-only "$1" | sed -nE 's/.* T (rc_[a-z_]+).*/\1/p' | sort; }
diff <(symbols "$scratch/libridgecast.so.1") <(symbols "$library") || { echo "the library exports other functions than its header declares"; exit 1; }
[[ $(symbols "$library" | wc -l) -eq $(grep -cE '^[^ /].*[ *]rc_[a-z_]+\(' "$folder/ridgecast.h") ]]
if [[ $how == write ]]; then
  abidw --no-corpus-path --no-comp-dir-path --no-show-locs --no-elf-needed --type-id-style hash "$scratch/libridgecast.so.1" |
    sed -E "s/ (path|comp-dir-path|filepath)='[^']*'//g" >"$folder/ridgecast.abi"
fi
abidiff "$folder/ridgecast.abi" "$scratch/libridgecast.so.1" || {
  echo "the C interface is not that of client/c/ridgecast.abi: functions, and fields at the end of structs with a size, may be added; then $0 ... write"
  exit 1
}
