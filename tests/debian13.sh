#!/usr/bin/env bash
# Runs the short tests in a tree of Debian 13, whose Python is 3.13: debian13.sh TREE. As root.
# TREE is made at the first time. This checkout is copied into it, with what is not committed yet.
set -euo pipefail
cd "$(dirname "$0")/.."
tree=$(realpath -m "$1")
[ "$(id -u)" = 0 ] || { echo "Only root can enter a tree: sudo make test-debian13"; exit 1; }
if [ ! -e "$tree/complete" ]; then
  rm -rf "$tree"
  mkdir -p "$(dirname "$tree")"
  packaging/mmdebstrap.sh trixie "$tree" --variant=apt --include=ca-certificates
  touch "$tree/complete"
fi
rm -rf "$tree/checkout"
git clone --quiet . "$tree/checkout"
git ls-files -z --cached --others --exclude-standard | tar -c --null --ignore-failed-read -T - 2>/dev/null |
  tar -x -C "$tree/checkout"
# How this machine reaches the network.
for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
  if [ -e "$file" ]; then cp -L "$file" "$tree$file"; fi
done
# The tree becomes the root, and not by chroot: what is in a chroot can make no namespaces of users.
exec unshare --mount --pid --fork --kill-child bash -euc '
  tree=$1
  mount --bind "$tree" "$tree"
  mount --rbind /dev "$tree/dev"
  mount -t tmpfs -o mode=1777 shm "$tree/dev/shm"
  mount -t proc proc "$tree/proc"
  mount --rbind /sys "$tree/sys"
  mount -t tmpfs -o mode=755 run "$tree/run"
  mount -t tmpfs -o mode=1777 tmp "$tree/tmp"
  cd "$tree"
  pivot_root . .
  umount -l .
  cd /checkout
  .ci/install
  make PYTHON=/usr/bin/python3 test
' - "$tree"
