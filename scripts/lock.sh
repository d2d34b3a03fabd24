#!/bin/sh
# Renews locks/*.txt from pyproject.toml, for every platform and Python from 3.11 on. Needs uv
# (the one in .venv, or on the PATH). Give arguments of `uv pip compile`, such as --upgrade.
#
#   scripts/lock.sh                                 keeps the versions that still fit
#   scripts/lock.sh --upgrade                       takes the newest
#   scripts/lock.sh --upgrade-package mujoco        takes the newest of one
set -eu
cd "$(dirname "$0")/.."
uv=.venv/bin/uv
[ -x "$uv" ] || uv=$(command -v uv) || { echo "lock.sh: no uv; run ./run doctor once, which installs it" >&2; exit 1; }

compile() { # output, inputs...
    output=$1
    shift
    "$uv" pip compile --no-config --quiet --universal --python-version 3.11 --generate-hashes \
        --no-emit-index-url --no-annotate --custom-compile-command scripts/lock.sh \
        --output-file "$output" "$@"
}

# What ./run demo needs; then what ./run test and ./run docs need on top, at the same versions.
compile locks/run.txt pyproject.toml --group build "$@"
compile locks/dev.txt pyproject.toml --group build --group dev --group docs \
    --constraints locks/run.txt "$@"
# What installs all that, by pip.
echo uv | "$uv" pip compile --no-config --quiet --universal --python-version 3.11 --generate-hashes \
    --no-emit-index-url --no-annotate --custom-compile-command scripts/lock.sh \
    --output-file locks/uv.txt - "$@"
