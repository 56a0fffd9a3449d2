#!/usr/bin/env bash
# Makes an environment in which lerobot and robomimic read what `physreal generate` writes: scripts/read_back.sh FOLDER
# Their pins ask for an older torch, whose build for the CPU is not on PyPI; so they are installed without their dependencies, beside those that reading needs.
set -euo pipefail
folder=$1
python3 -m venv "$folder"
install() { "$folder/bin/pip" install -q "$@"; }
install torch==2.13.0
install 'datasets>=4,<5' 'huggingface-hub<0.36' 'av>=15,<16' jsonlines einops draccus==0.10.0 'gymnasium<2' 'packaging<26' deepdiff termcolor \
    imageio imageio-ffmpeg pandas h5py 'opencv-python-headless<4.13' safetensors tensorboardX psutil tqdm matplotlib six
install --no-deps lerobot==0.4.4 robomimic==0.3.0 accelerate torchvision==0.28.0 torchcodec==0.13.0
ldconfig -p | grep -q libavcodec || echo 'torchcodec needs the libraries of FFmpeg: apt-get install ffmpeg' >&2
