#!/usr/bin/env bash
# Runs a program on a server of alpine of its own:  on_server.sh SERVER PROGRAM, which is given the server's URL
set -euo pipefail
scratch=$(mktemp -d)
"$1" --terrain alpine --port 0 --port-file "$scratch/port" >"$scratch/log" 2>&1 &
server=$!
trap 'kill "$server" 2>/dev/null || true; wait "$server" || true; rm -rf "$scratch"' EXIT
until [[ -s $scratch/port ]]; do
  kill -0 "$server" 2>/dev/null || { cat "$scratch/log"; exit 1; }
  sleep 0.05
done
"$2" "ws://127.0.0.1:$(<"$scratch/port")"
