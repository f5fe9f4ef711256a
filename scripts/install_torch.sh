#!/bin/sh
# Install torch into a virtual environment: without a word to the contrary its CPU build, 0.2 GB to download, where
# plain pip on Linux would take the CUDA build and its libraries, some 3 GB.
#
# Usage: install_torch.sh <python of the environment> [cpu | auto | cu128 | ...]     builds as `uv --torch-backend` names them
set -u
python=$1
build=${2:-cpu}
version=$(sed -n 's/^torch==//p' "$(dirname "$0")/../constraints.txt")
pip() { "$python" -m pip install -qq --no-compile --disable-pip-version-check "$@"; }

# this suffices if pip is configured for CPU builds; otherwise it fails immediately
if [ "$build" = cpu ] && pip "torch==$version+cpu" 2>/dev/null; then exit 0; fi
if [ "$(uname -s)" != Linux ]; then pip "torch==$version"; exit; fi # pip has one build only

# uv knows where each build is; where it is not installed it is fetched for this one step
uv=$(command -v uv)
if [ -z "$uv" ]; then
    folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
    pip --target "$folder" uv && uv=$folder/bin/uv
fi
if [ -n "$uv" ] && "$uv" pip install -q --python "$python" --torch-backend="$build" "torch==$version"; then exit 0; fi
echo "uv could not get torch's $build build: taking what pip finds, on Linux most often the CUDA build (3 GB)" >&2
pip "torch==$version"
