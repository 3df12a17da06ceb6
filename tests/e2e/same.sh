#!/usr/bin/env bash
# All runs of a program print the same, one alone and three at once. SIMULATED: seconds, instead of its own.  same.sh PROGRAM
set -euo pipefail
run() { "$program" ${SIMULATED:+"$SIMULATED"}; }
program=$1
alone=$(run) || { echo "$alone"; exit 1; }
echo "$alone"
exec {a}< <(run) {b}< <(run) {c}< <(run)
for other in "$a" "$b" "$c"; do
  printed=$(cat <&"$other")
  [[ $alone == "$printed" ]] || { echo "another run differs: $printed"; exit 1; }
done
