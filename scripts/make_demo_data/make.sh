#!/usr/bin/env bash
# Makes data/demo again: renders the photos with Blender, then runs COLMAP on them.
#
#   scripts/make_demo_data/make.sh [OUT=data/demo]
#
# Needs Debian's blender (3.4) and colmap (3.8); both run on the CPU. The scene, the camera path and
# the noise of the photos follow from one seed in render.py. COLMAP's model differs in its last digits
# from run to run (its threads).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=$(realpath -m "${1:-$here/../../data/demo}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export QT_QPA_PLATFORM=offscreen

for tool in blender colmap; do
  command -v "$tool" > /dev/null || { echo "missing: apt-get install $tool" >&2; exit 2; }
done

if [[ -e $out/images || -e $out/sparse ]]; then
  echo "$out already holds a capture; remove its images/ and sparse/ first" >&2
  exit 2
fi

mkdir -p "$out"
nice -n 15 blender -b --factory-startup -P "$here/render.py" -- "$out/images" |
  grep -E '^(lens|Saved)'

run() { nice -n 15 colmap "$@" > "$work/log" 2>&1 || { tail -n 30 "$work/log" >&2; exit 1; }; }
run feature_extractor --database_path "$work/database.db" --image_path "$out/images" \
  --ImageReader.single_camera 1 --ImageReader.camera_model SIMPLE_RADIAL \
  --SiftExtraction.use_gpu 0 --SiftExtraction.max_num_features 1300
run exhaustive_matcher --database_path "$work/database.db" --SiftMatching.use_gpu 0
mkdir "$work/sparse"
run mapper --database_path "$work/database.db" --image_path "$out/images" \
  --output_path "$work/sparse"
mkdir -p "$out/sparse"
cp -r "$work/sparse/0" "$out/sparse/0"
rm "$out/sparse/0/project.ini"  # COLMAP's own command line: paths of this machine, not of the model

colmap model_analyzer --path "$out/sparse/0" 2>&1
du -sb "$out"
