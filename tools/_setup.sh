# Sourced by the programs of this folder: makes .venv from the lock, and installs the system programs that are missing.
# Everything it says goes to the error output; a second run finds its stamps and is silent.

set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv

say() { printf '%s\n' "$*" >&2; }

die() {
    say "tools/${0##*/}: $*"
    exit 1
}

# Quiet unless it fails: then everything it said is what the reader needs.
quietly() {
    local said status=0
    said=$("$@" </dev/null 2>&1) || status=$?
    if [ "$status" -ne 0 ]; then
        say "$said"
    fi
    return "$status"
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    else
        sudo -n "$@"
    fi
}

can_be_root() {
    [ "$(id -u)" -eq 0 ] || sudo -n true </dev/null >/dev/null 2>&1
}

install_packages() { # PACKAGE…
    local mend="sudo apt-get update && sudo apt-get install -y --no-install-recommends $*"
    command -v apt-get >/dev/null || die "missing: $*; install them with this system's package manager"
    can_be_root || die "missing: $*; run: $mend"
    say "Installing $* (system packages, needed and not there)"
    quietly as_root apt-get update || die "apt-get update failed; when the network is back, run: $mend"
    quietly as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@" ||
        die "apt-get install failed; run: $mend"
}

need_programs() { # PROGRAM=PACKAGE…
    local pair missing=()
    for pair in "$@"; do
        PATH=$PATH:/usr/sbin:/sbin command -v "${pair%=*}" >/dev/null || missing+=("${pair#*=}")
    done
    [ ${#missing[@]} -eq 0 ] || install_packages "${missing[@]}"
}

version_of() { "$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null; }

is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

find_python() {
    local name
    for name in python3 python3.14 python3.13 python3.12 python3.11; do
        if is_new_enough "$name"; then
            command -v "$name"
            return
        fi
    done
    name=$(version_of python3) || die "python3 is missing; run: sudo apt-get update && sudo apt-get install -y python3 python3-venv"
    die "needs Python 3.11 or newer, python3 is $name; run: sudo apt-get update && sudo apt-get install -y python3.11 python3.11-venv"
}

# Debian splits both out of python3, and without the second one venv fails only after it has made half a folder.
has_venv() { "$1" -c 'import venv, ensurepip' 2>/dev/null; }

need_venv() { # PYTHON
    local version
    has_venv "$1" && return
    version=$(version_of "$1")
    install_packages "python${version%.*}-venv"
    has_venv "$1" || die "$1 cannot make virtual environments; run: sudo apt-get install -y python${version%.*}-venv"
}

is_stamped() { # NAME TEXT
    [ "$(cat "$venv/.$1" 2>/dev/null)" = "$2" ]
}

pip_install() {
    quietly "$venv/bin/python" -m pip --disable-pip-version-check --no-input install --quiet "$@"
}

# A stamp is written when its step is complete, so an interrupted step is done again, from an empty folder.
install_lock() { # PYTHON
    local stamp
    stamp="$(version_of "$1") $root $(sha256sum <"$root/requirements.txt")"
    is_stamped lock "$stamp" && "$venv/bin/python" -c '' 2>/dev/null && return
    [ ! -L "$venv" ] || die "$venv is a link to another folder's, which would be emptied; remove the link: rm '$venv'"
    need_venv "$1"
    say "Making .venv with Python $(version_of "$1") (the system's packages stay untouched)"
    quietly "$1" -m venv --clear "$venv" || die "cannot make $venv; remove it and run this again: rm -rf '$venv'"
    say "Installing the packages of requirements.txt (each checked against its hash; takes a minute)"
    pip_install --require-hashes -r "$root/requirements.txt" || die "pip failed, see above; when mended, run this again"
    printf '%s\n' "$stamp" >"$venv/.lock"
}

# A C compiler and Python's headers, which Debian splits out of python3.
has_compiler() { # PYTHON
    command -v cc >/dev/null && [ -e "$("$1" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h" ]
}

# For what tests the C code; everything else runs without it.
need_compiler() {
    local python version
    python=$(find_python)
    has_compiler "$python" && return
    version=$(version_of "$python")
    install_packages gcc libc6-dev "libpython${version%.*}-dev"
    has_compiler "$python" || die "no C compiler, or no headers of $python; run: sudo apt-get install -y gcc python3-dev"
}

# Again when the C code changes, or when a compiler has come that can build it.
install_project() {
    local stamp
    stamp=$(cat "$root/pyproject.toml" "$root/hatch_build.py" "$root/vehicle_iface/"_wire*.[ch] | sha256sum)
    stamp="$stamp $(has_compiler "$venv/bin/python" && printf 'with' || printf 'without') a compiler"
    is_stamped project "$stamp" && return
    say "Installing vehicle-iface into .venv (editable: changes to the source take effect at once)"
    pip_install --no-deps --no-build-isolation -e "$root" || die "pip failed, see above; when mended, run this again"
    printf '%s\n' "$stamp" >"$venv/.project"
}

# The lock on a file that is there anyway keeps two first runs from making one folder at the same time.
set_up() {
    local python
    flock -n 9 || { say "Waiting for another set-up of this folder to end" && flock 9; }
    python=$(find_python)
    install_lock "$python"
    install_project
} 9<"$root/pyproject.toml"

# Sets up what is missing, then becomes a module of tools/ or of the project.
run_module() { # MODULE ARGUMENTS…
    set_up
    export PYTHONPATH=$root:$root/viewer:$root/tools${PYTHONPATH:+:$PYTHONPATH}
    exec "$venv/bin/python" -P -m "$@"
}
