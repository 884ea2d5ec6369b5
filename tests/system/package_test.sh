#!/usr/bin/env bash
# package_test.sh DEB: installs the package in a fresh Debian 12 below a temporary folder (debootstrap), looks at files,
# configuration, users and units, installs it again, removes and purges it, and checks that nothing but the user is left.
# Takes root and a Debian mirror; says that it skips (exit 0) without root, debootstrap or /proc.
set -euo pipefail
deb=$(realpath "${1:?usage: package_test.sh DEB}")
mirror=${ROTUNDA_DEBIAN_MIRROR:-http://deb.debian.org/debian}

skip() { echo "package test: skipped, $*"; exit 0; }
fail() { echo "package test: $*" >&2; exit 1; }
step() { echo "package test: $*"; }

[ "$(id -u)" = 0 ] || skip "it takes root"
command -v debootstrap >/dev/null || skip "debootstrap is not installed (apt-get install debootstrap)"

work=$(mktemp -d)
root=$work/root
clean_up() {
  umount "$root/proc" 2>/dev/null || true
  # Not into anything that is still mounted.
  rm -rf --one-file-system "$work"
}
trap clean_up EXIT

inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive LC_ALL=C "$@"; }
# Runs it with its output in a log that is shown when it fails.
quietly() { "$@" >>"$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; fail "failed: $*"; }; }

# Everything below /, but for what changes by itself: dpkg's and apt's books, logs, caches, temporary files.
everything() {
  (cd "$root" && find . -xdev \( -path ./proc -o -path ./var/lib/dpkg -o -path ./var/lib/apt -o -path ./var/log \
    -o -path ./var/cache -o -path ./tmp -o -path ./run \) -prune -o -print | sort)
}

step "a fresh Debian below $root"
quietly debootstrap --variant=minbase bookworm "$root" "$mirror"
mkdir -p "$root/proc"
mount -t proc proc "$root/proc" 2>/dev/null || skip "/proc cannot be mounted there"
cp "$deb" "$root/tmp/rotunda.deb"

step "what the package needs"
quietly inside apt-get update -qq
quietly inside apt-get satisfy -y -qq --no-install-recommends "$(dpkg-deb --field "$deb" Depends)"
everything >"$work/before"

step "install"
quietly inside dpkg --install /tmp/rotunda.deb
[ "$(inside dpkg-query -W -f='${db:Status-Status}' rotunda)" = installed ] || fail "it is not installed"

step "files"
for file in /usr/bin/rotunda /usr/sbin/rotundad /lib/systemd/system/rotunda.service /lib/systemd/system/rotunda.socket \
  /usr/lib/sysusers.d/rotunda.conf /usr/lib/tmpfiles.d/rotunda.conf /usr/lib/udev/rules.d/60-rotunda-gpio.rules \
  /usr/lib/sysctl.d/60-rotunda.conf /usr/share/bash-completion/completions/rotunda /usr/share/bash-completion/completions/rotundad /usr/share/rotunda/rig-90.toml \
  /usr/share/doc/rotunda/copyright /etc/rotunda/rotundad.toml /etc/rotunda/capture.toml /etc/rotunda/cuboid.toml; do
  [ -s "$root$file" ] || fail "$file is missing"
done
strange=$(inside dpkg-query -L rotunda | grep -Ev '^/(\.|etc|etc/rotunda(/.*)?|usr(/.*)?|lib(/.*)?)$' || true)
[ -z "$strange" ] || fail "it has files elsewhere: $strange"
writable=$(inside dpkg-query -L rotunda | while read -r path; do find "$root$path" -maxdepth 0 ! -type l \( -perm /022 -o ! -user 0 \); done)
[ -z "$writable" ] || fail "others than root may write: $writable"

step "programs and configuration"
quietly inside rotunda --help
quietly inside rotundad --check-config
quietly inside bash -n /usr/share/bash-completion/completions/rotunda
quietly inside bash -n /usr/share/bash-completion/completions/rotundad

step "users and folders"
inside getent passwd rotunda >/dev/null || fail "there is no user rotunda"
for group in rotunda rotunda-operator gpio; do
  inside getent group "$group" >/dev/null || fail "there is no group $group"
done
[[ " $(inside id -nG rotunda) " == *" gpio "* ]] || fail "the user rotunda is not in the group gpio"
[ "$(inside stat -c '%U:%G %a' /var/lib/rotunda)" = 'rotunda:rotunda 700' ] ||
  fail "/var/lib/rotunda: $(inside stat -c '%U:%G %a' /var/lib/rotunda)"

step "units"
# It ends with 0 also when it does not know a key: its output must be empty.
said=$(inside systemd-analyze verify rotunda.service rotunda.socket 2>&1) || fail "systemd-analyze verify: $said"
[ -z "$said" ] || fail "systemd-analyze verify: $said"
quietly inside systemd-analyze security --offline=true --threshold=20 --no-pager rotunda.service

step "install again: what the operator has entered stays"
echo '# mine' >>"$root/etc/rotunda/capture.toml"
quietly inside dpkg --install --force-confold /tmp/rotunda.deb
grep -q '^# mine$' "$root/etc/rotunda/capture.toml" || fail "capture.toml was written over"

step "remove: configuration and captures stay"
mkdir -p "$root/var/lib/rotunda/captures/one"
quietly inside dpkg --remove rotunda
[ ! -e "$root/usr/sbin/rotundad" ] || fail "rotundad is still there"
[ -s "$root/etc/rotunda/capture.toml" ] || fail "the configuration went"

step "purge"
quietly inside dpkg --purge rotunda
[ -d "$root/var/lib/rotunda/captures/one" ] || fail "captures were removed along"
rm -r "$root/var/lib/rotunda/captures"
quietly inside dpkg --install /tmp/rotunda.deb
quietly inside dpkg --purge rotunda
[ ! -e "$root/run/rotunda" ] || fail "/run/rotunda was left"
everything >"$work/after"
# The user stays (it owns captures), and with it the old copies of the user database.
left=$(diff "$work/before" "$work/after" | grep '^[<>]' | grep -Ev '^> \./etc/(passwd|group|shadow|gshadow)-$' || true)
[ -z "$left" ] || fail "this has changed: $left"
echo "package test: passed"
