#!/usr/bin/env bash
# Two runs of a program print the same. SIMULATED: seconds, instead of its own.  twice.sh PROGRAM
set -euo pipefail
first=$("$1" ${SIMULATED:+"$SIMULATED"}) || { echo "$first"; exit 1; }
second=$("$1" ${SIMULATED:+"$SIMULATED"})
echo "$first"
[[ $first == "$second" ]] || { echo "the second run differs: $second"; exit 1; }
