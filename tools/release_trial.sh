#!/bin/sh
# Makes the wheel in a fresh clone of the last commit, installs it into an environment of its own, and runs the demo and the
# golden vectors there in an empty folder. What was built or installed in this checkout takes no part.
set -eu
cd "$(dirname "$0")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
echo "plumb: a wheel from a fresh clone"
git clone -q . "$folder/clone"
make -s -C "$folder/clone" wheel >"$folder/wheel.log" 2>&1 || {
    tail -n 40 "$folder/wheel.log"
    exit 1
}
"$folder/clone/.venv/bin/python" -m venv "$folder/environment"
"$folder/environment/bin/pip" install -q --disable-pip-version-check "$(ls "$folder"/clone/dist/*.whl)[virtual]"
rm -rf "$folder/clone" # nothing that is installed may lead back to the sources
mkdir "$folder/empty"
cd "$folder/empty"
"$folder/environment/bin/plumb" golden check --json >golden.json &
golden=$!
"$folder/environment/bin/plumb" demo --seconds 6
wait "$golden" || {
    cat golden.json
    exit 1
}
echo "plumb: the installed wheel passes its demo and its golden vectors"
