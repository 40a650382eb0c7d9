# What CI runs, in its order; `.ci/run` does the same without `just`.
default: fmt-check lint core test doc interop browser package

# The code is formatted.
fmt-check:
    cargo fmt --all --check

# No warning in any target.
lint:
    cargo clippy --workspace --all-targets --locked -- -D warnings

# The brain builds without input and output.
core:
    cargo check -p stockpilot --lib --no-default-features --locked

# Every test.
test:
    cargo test --workspace --locked

# The documentation builds without a broken link.
doc:
    RUSTDOCFLAGS='-D warnings' cargo doc --workspace --no-deps --locked

# Programs that others wrote: readers of the log, pymavlink, MAVProxy, MAVSDK.
interop:
    bash tests/interop/run target/interop target/debug target/tmp

# The live page in Chromium during a flight; its screenshots are in target/browser-pictures.
browser:
    bash tests/browser/run target/browser target/debug target/browser-pictures target/tmp

# The Debian package of the program that the tests have built; as root with CI=true also installed, flown, upgraded and purged.
package:
    bash tests/package/run target/package target/debug/stockpilot target/debug/stockpilot-sim fly

# The Debian packages for amd64 and arm64, into target/debian (what it needs: `deploy/package`).
deb:
    deploy/package

# The package for arm64, built here and started in emulation; a quarter of an hour, so by hand only: CI does not do it.
arm64 LOG="target/tmp/survey/survey-earlier.mcap":
    deploy/package arm64
    tests/package/arm64 target/debian/stockpilot_*_arm64.deb {{LOG}}

# One simulated flight through the real service: `just fly --world piles --planner square-wave`.
fly *ARGS:
    cargo run --release -p stockpilot-sim --locked -- fly {{ARGS}}

# Many flights without bytes and threads: `just campaign --world alps --seeds 0..20`.
campaign *ARGS:
    cargo run --release -p stockpilot-sim --locked -- campaign {{ARGS}}

# Every case of the fault harness on both families of autopilots, three minutes: `just faults --seed 3`.
faults *ARGS:
    cargo run --release -p stockpilot-sim --locked -- faults {{ARGS}}

# Is the localisation as sure as it says? `just consistency --latency-ms 10,30,150 --out nees`.
consistency *ARGS:
    cargo run --release -p stockpilot-sim --locked -- consistency {{ARGS}}

# Advisories, licences, sources and duplicates of the dependencies (needs cargo-deny).
deny:
    cargo deny --locked check

# Other people's clients read the emulated LiDARs; `just interop` does too.
interop-lidar:
    bash tests/interop/run_lidar target/interop-lidar target/debug/stockpilot-sim
