#!/usr/bin/env bash
# Builds the Debian packages in a clean Debian 12 and checks them with lintian: deb.sh WHEELS OUT
# WHEELS has the wheels of ecatd and of the Python libraries that it needs. Root, or a user with subordinate
# user numbers, can run it; it needs mmdebstrap.
set -euo pipefail
cd "$(dirname "$0")/.."
wheels=$(realpath "$1") out=$(realpath -m "$2")
version=$(sed -n 's/^VERSION = "\(.*\)"$/\1/p' daemon/ecatd/base/version.py)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
source=$work/ecatd-$version
mkdir -p "$source" "$out" "$work/debs"
cp -r packaging/debian client_c LICENSE "$source"
cp -r "$wheels" "$source/wheels"
cat >"$source/debian/changelog" <<C
ecatd ($version) unstable; urgency=medium

  * Built from a checkout.

 -- the ecatd authors <ecatd@packages.invalid>  $(git log -1 --format=%cD 2>/dev/null || date -R)
C
packaging/mmdebstrap.sh bookworm /dev/null --variant=apt \
  --include=build-essential,debhelper,lintian,cmake,python3,python3-pip \
  --customize-hook="copy-in $source /" \
  --customize-hook="chroot \"\$1\" sh -euc 'cd /ecatd-$version && dpkg-buildpackage -b -us -uc >/log 2>&1 || { cat /log; exit 1; }'" \
  --customize-hook="chroot \"\$1\" sh -uc 'cd / && lintian --allow-root --fail-on error --suppress-tags-from-file /ecatd-$version/debian/lintian-tags *.changes'" \
  --customize-hook="mkdir \"\$1/out\" && mv \"\$1\"/*.deb \"\$1/out\"" \
  --customize-hook="sync-out /out $work/debs"
cp "$work"/debs/*.deb "$out"  # mmdebstrap splits the words of a hook, and $out may have a space
ls -l "$out"/*.deb
