# Completion of `ros2 run PACKAGE EXECUTABLE --flags` for this suite: source tools/completion.bash
_imu_noise_id_flags() {
    case "$1 $2" in
    "imu_noise_id identify") echo --bag --output --last --topic --json --scheduler --help --ros-args ;;
    "imu_noise_id simulate") echo --model --duration --seed --output --help ;;
    "imu_noise_id reconcile") echo --bag --model --simulation --output --seed --topic --help ;;
    "imu_noise_id export") echo --model --format --rate --output --help ;;
    "nav_fusion fuse") echo --bag --model --output --set --topic --json --help --ros-args ;;
    "nav_fusion budget") echo --model --output --duration --temperature --vibration --turn-on-gyro --turn-on-accel --help ;;
    "nav_fusion play") echo --bag --rate --loop --topics --wait --help --ros-args ;;
    esac
}

_imu_noise_id_complete() {
    local current=${COMP_WORDS[COMP_CWORD]} words=""
    case $COMP_CWORD in
    1) words="run pkg" ;;
    2) words="imu_noise_id nav_fusion executables" ;;
    3) words=$(ros2 pkg executables "${COMP_WORDS[2]}" 2>/dev/null | awk '{print $2}') ;;
    *) words=$(_imu_noise_id_flags "${COMP_WORDS[2]}" "${COMP_WORDS[3]}") ;;
    esac
    if [ "${COMP_WORDS[COMP_CWORD - 1]}" = --format ]; then
        words="kalibr robot_localization gtsam gazebo"
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
    if [ ${#COMPREPLY[@]} = 0 ]; then
        compopt -o default
    fi
}

complete -F _imu_noise_id_complete ros2
