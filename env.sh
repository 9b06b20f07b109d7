# Sourced from any folder by bash or zsh (by a plain sh in the workspace's own folder): after it
# `ros2 run PKG EXE` works.  Puts the workspace on the paths as ROS 2 does, and none of .venv's
# packages, so that every other Python stays as it was.

_ws_first() { # ENTRY PATHS: PATHS with ENTRY in front, and nowhere else
    _ws_rest=":$2:"
    while case $_ws_rest in *":$1:"*) true ;; *) false ;; esac do
        _ws_rest="${_ws_rest%%":$1:"*}:${_ws_rest#*":$1:"}"
    done
    _ws_rest=${_ws_rest#:}
    _ws_rest=${_ws_rest%:}
    printf '%s' "$1${_ws_rest:+:$_ws_rest}"
}

_ws_file=${BASH_SOURCE:-./env.sh}
[ -z "${ZSH_VERSION:-}" ] || eval '_ws_file=${(%):-%x}'
_ws_root=$(CDPATH='' cd -P -- "$(dirname -- "$_ws_file")" >/dev/null && pwd -P)

if [ ! -f "$_ws_root/build/state" ] || [ ! -d "$_ws_root/install" ]; then
    echo "env.sh: the workspace is not built; next: make -C $_ws_root build, then source env.sh again" >&2
    unset -f _ws_first
    return 1
fi

_ws_ros=${ROS_JAZZY:-/opt/ros/jazzy}
if [ -f "$_ws_ros/setup.sh" ]; then
    _ws_options=$-
    set +eu # ROS's own scripts read variables that are not set
    . "$_ws_ros/setup.sh"
    case $_ws_options in *e*) set -e ;; esac
    case $_ws_options in *u*) set -u ;; esac
else
    AMENT_PREFIX_PATH=$(_ws_first "$_ws_root/.venv" "${AMENT_PREFIX_PATH:-}")
fi
AMENT_PREFIX_PATH=$(_ws_first "$_ws_root/install" "${AMENT_PREFIX_PATH:-}")
LD_LIBRARY_PATH=$(_ws_first "$_ws_root/install/lib" "${LD_LIBRARY_PATH:-}")
for _ws_path in "$_ws_root"/install/lib/python3.*/site-packages \
    "$_ws_root/build/nav_fusion" "$_ws_root/build/imu_noise_id"; do
    PYTHONPATH=$(_ws_first "$_ws_path" "${PYTHONPATH:-}")
done
case $(command -v ros2 || true) in
"" | */tools/bin/ros2) PATH=$(_ws_first "$_ws_root/tools/bin" "$PATH") ;; # the stand-in
esac
export AMENT_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH PATH
# left by the Python of another environment of wheels, it would keep .venv from its own libraries
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE

unset -f _ws_first
unset _ws_file _ws_root _ws_ros _ws_path _ws_options
