#!/usr/bin/env bash
# Whether what these Markdown files link to is there, as far as it is a file:  links.sh FILE...
set -euo pipefail
missing=0
for file in "$@"; do
  while IFS= read -r target; do
    [[ -e $(dirname "$file")/$target ]] || { echo "$file: there is no $target"; missing=1; }
  done < <(grep -oP '\]\(\K(?!\w+:)[^)#\s]+' "$file" || true)
done
exit "$missing"
