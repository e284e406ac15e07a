#!/usr/bin/env bash
# Installs the units, the udev rules and the user of flightapp, or removes them. A second time changes nothing.
set -euo pipefail

usage() {
    cat <<'END'
systemd/install.sh [--dry-run] [--root DIR] [--app DIR] [--t265-python FILE] [--udp-link] [--csi-camera]
systemd/install.sh --uninstall [--dry-run] [--root DIR]

  --dry-run           only say what would be done
  --root DIR          into DIR instead of /: files alone, nothing is asked of the running system
  --app DIR           where this checkout is when the service runs; default: where it is now
  --t265-python FILE  the interpreter that has pyrealsense2; default: /usr/bin/python3
  --udp-link          let the service use private networks, for MAVLink over UDP; without, it may not (any more)
  --csi-camera        the same for a Jetson's CSI camera
  --uninstall         remove what was installed; flight records, the user, and files that you changed are kept
END
}

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root='' app=${here%/systemd} python=/usr/bin/python3 dry='' uninstall='' dropins=()

fail() {
    printf 'install.sh: %s\n' "$*" >&2
    exit 2
}

while (($#)); do
    case $1 in
        --dry-run) dry=yes ;;
        --uninstall) uninstall=yes ;;
        --udp-link | --csi-camera) dropins+=("${1#--}") ;;
        --root | --app | --t265-python)
            (($# > 1)) || fail "$1 takes a value"
            case $1 in
                --root) root=${2%/} ;;
                --app) app=${2%/} ;;
                *) python=$2 ;;
            esac
            shift
            ;;
        -h | --help) usage && exit 0 ;;
        *) usage >&2 && fail "unknown option $1" ;;
    esac
    shift
done
[[ -z $root || -d $root ]] || fail "--root $root: there is no such directory"
[[ -n $root || -n $dry || $(id -u) == 0 ]] || fail "only root may do this: sudo $0, or give --root DIR or --dry-run"

units=/etc/systemd/system
etc=/etc/flightapp
list=$root$etc/.installed # a line each: "dir PATH" or "file SHA256 PATH", in the order in which they were made
noted=()
[[ -f $list ]] && mapfile -t noted <"$list"

say() { printf '%s%s\n' "${dry:+would: }" "$*"; }

run() {
    say "$*"
    [[ -n $dry ]] || "$@"
}

# live COMMAND…: asks it of the running system; not with --root, and where it fails that is told and nothing more.
live() {
    [[ -z $root ]] || return 0
    run "$@" || say "failed: $*"
}

digest() { sha256sum <"$1" | cut -d ' ' -f 1; }

# known PATH: the digest with which PATH was installed, if it was
known() {
    local line
    for line in "${noted[@]}"; do
        [[ $line == "file "*" $1" ]] && line=${line#file } && printf '%s' "${line%% *}"
    done
    return 0
}

note_file() {
    local i
    for i in "${!noted[@]}"; do
        if [[ ${noted[i]} == "file "*" $2" ]]; then
            noted[i]="file $1 $2"
            return
        fi
    done
    noted+=("file $1 $2")
}

# make_dir PATH: the directory below the root and those above it; what was not there is noted
make_dir() {
    [[ -z $1 || -d $root$1 ]] && return
    [[ -n $dry && " ${noted[*]} " == *" dir $1 "* ]] && return
    make_dir "${1%/*}"
    run mkdir -m 0755 "$root$1"
    noted+=("dir $1")
}

# put PATH MODE [keep]: standard input becomes the file; with "keep", not over one that somebody changed
put() {
    local target=$root$1 fresh was
    fresh=$(mktemp)
    cat >"$fresh"
    was=$(known "$1")
    if [[ ${3-} == keep && -e $target && $(digest "$target") != "$was" ]]; then
        say "keep $target, which was changed"
    else
        make_dir "${1%/*}"
        if [[ -e $target ]] && cmp -s "$fresh" "$target"; then
            say "leave $target as it is"
        else
            run install -m "$2" -T "$fresh" "$target"
        fi
        note_file "$(digest "$fresh")" "$1"
    fi
    rm -f "$fresh"
}

fitted() { sed -e "s|/opt/flightapp|$app|g" -e "s|^ExecStart=/usr/bin/python3|ExecStart=$python|" "$1"; }

drop() {
    local path=$root$1
    if [[ -e $path || -L $path ]]; then run rm -f "$path"; fi
}

install_all() {
    case $app/ in # what ProtectHome= and PrivateTmp= hide from the units
        /home/* | /root/* | /run/user/* | /tmp/*)
            fail "the service may not look into $app; clone to /opt/flightapp, run make race there, and install from there"
            ;;
    esac
    [[ $app == /* && $app != *[[:space:]\|\&]* ]] || fail "--app $app: give an absolute path without blanks"
    [[ $python == /* && $python != *[[:space:]\|\&]* ]] || fail "--t265-python $python: give an absolute path without blanks"
    [[ -n $root || -n $dry || -x $app/.venv/bin/flightapp ]] || fail "$app/.venv/bin/flightapp is missing; run make race in $app"
    local one
    put $etc/flightapp.env 0644 keep <"$here/flightapp.env"
    for one in flightapp flightapp-t265; do
        put $units/$one.service 0644 < <(fitted "$here/$one.service")
    done
    for one in udp-link csi-camera; do
        if [[ " ${dropins[*]} " == *" $one "* ]]; then
            put $units/flightapp.service.d/$one.conf 0644 <"$here/dropins/$one.conf"
        else
            drop $units/flightapp.service.d/$one.conf
        fi
    done
    put /etc/udev/rules.d/60-flightapp.rules 0644 <"$here/60-flightapp.rules"
    put /etc/sysusers.d/flightapp.conf 0644 <"$here/sysusers.conf"
    put /usr/local/bin/flightapp 0755 <<<"#!/bin/sh
exec $app/.venv/bin/flightapp \"\$@\""
    [[ -n $dry ]] || printf '%s\n' "${noted[@]}" >"$list"
    live systemd-sysusers /etc/sysusers.d/flightapp.conf
    live systemctl daemon-reload
    live udevadm control --reload
    live udevadm trigger --subsystem-match=usb --subsystem-match=tty --subsystem-match=video4linux
    cat <<END
next: edit $etc/flightapp.env, then
  systemctl enable --now flightapp          (and flightapp-t265, for a T265)
  usermod -aG flightapp NAME                for who may command it
END
}

remove_all() {
    [[ -f $list ]] || fail "nothing of flightapp is installed${root:+ in $root}: there is no $list"
    live systemctl disable --now flightapp.service flightapp-t265.service
    local line path i
    for line in "${noted[@]}"; do
        [[ $line == file\ * ]] || continue
        line=${line#file } && path=${line#* }
        if [[ $path == "$etc/flightapp.env" && -e $root$path && $(digest "$root$path") != "${line%% *}" ]]; then
            say "keep $root$path, which was changed"
        else
            drop "$path"
        fi
    done
    drop $etc/.installed
    for ((i = ${#noted[@]} - 1; i >= 0; i--)); do
        [[ ${noted[i]} == dir\ * ]] || continue
        path=$root${noted[i]#dir }
        [[ -d $path ]] || continue
        if [[ -n $dry || -z $(ls -A "$path") ]]; then run rmdir "$path"; else say "keep $path, which holds more"; fi
    done
    live systemctl daemon-reload
    live udevadm control --reload
    [[ -n $root ]] || say "kept: the user and group flightapp, /var/log/flightapp (flight records), /var/lib/flightapp, /var/cache/flightapp"
}

if [[ -n $uninstall ]]; then remove_all; else install_all; fi
