#!/usr/bin/env bash
# A target of the compiler in (`scripts/package.sh x86_64-unknown-linux-musl`); an archive of the program with its licences and
# its checksum out, in `target/package`.
set -euo pipefail
cd "$(dirname "$0")/.."

target=${1:?usage: scripts/package.sh TARGET, for example x86_64-unknown-linux-musl}
out=target/package
# The C libraries of a static build come from the compiler of musl.
case $target in
*-musl)
    command -v musl-gcc >/dev/null || { echo "musl-gcc is missing: install musl-tools"; exit 1; }
    name=$(printf %s "$target" | tr a-z- A-Z_)
    export "CC_${target//-/_}=musl-gcc" "CARGO_TARGET_${name}_LINKER=musl-gcc"
    ;;
esac

cargo build --release --locked --target "$target"

program=koehler
case $target in *-windows-*) program=koehler.exe ;; esac
built=${CARGO_TARGET_DIR:-target}/$target/release/$program
version=$("$built" --version | cut -d' ' -f2)
folder=koehler-$version-$target
rm -rf "${out:?}/$folder"
mkdir -p "$out/$folder"
cp "$built" README.md LICENSE-APACHE LICENSE-MIT "$out/$folder"
cp -r docs schemas "$out/$folder"
# A complete example; what runs have left there is not part of it.
mkdir -p "$out/$folder/pipelines"
git ls-files pipelines/citation | tar -cf - -T - | tar -xf - -C "$out/$folder"
tar -czf "$out/$folder.tar.gz" -C "$out" "$folder"
# The sums of macOS are another program's.
sum() { if command -v sha256sum >/dev/null; then sha256sum "$@"; else shasum -a 256 "$@"; fi; }
(cd "$out" && sum "$folder.tar.gz" >"$folder.tar.gz.sha256")
ls -l "$out/$folder.tar.gz"
