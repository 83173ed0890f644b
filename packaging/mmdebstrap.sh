#!/usr/bin/env bash
# mmdebstrap with packages from where this machine has its own: mmdebstrap.sh SUITE TARGET OPTION...
set -euo pipefail
suite=$1 target=$2
shift 2
sources=$(ls /etc/apt/sources.list.d/debian.sources 2>/dev/null || echo /etc/apt/sources.list)
options=()
for file in /etc/apt/apt.conf.d/*; do
  if grep -qiE 'proxy|Acquire|Verify' "$file"; then options+=("--aptopt=$file"); fi
done
sed "s/\b\(bookworm\|trixie\|stable\|testing\|sid\)\b/$suite/g" "$sources" |
  mmdebstrap --quiet "${options[@]}" "$@" "$suite" "$target" -
