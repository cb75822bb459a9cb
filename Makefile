# `make look` audits a committed ledger, `make demo` runs a federation whose updates are proven, and `make test` runs every check and test. Each target
# installs what it needs. CONTRIBUTING.md says which target is for what.

ROUNDS ?= 1
NODES ?= 3
CONFIDENCE ?= 99%
FULL_SAMPLES ?= 4
SUITE ?= trixie
BASE ?= origin/main
# Outside the clone, so that checkouts share one build.
export CARGO_TARGET_DIR ?= $(HOME)/.cache/zk0/target
RUST := scripts/with-rust
ZK0 := $(CARGO_TARGET_DIR)/release/zk0
SUDO := $(if $(filter-out 0,$(shell id -u)),sudo)

.PHONY: look demo test hiding deletions attacks drills mutants quick lint coverage setup build image wheel deb guest fixtures book cycles prove-full round-full bench-succinct fidelity power bench-ledger bench-years bench-recording bench-train bench-decode bench-fedavg bench-load bench-simulate cuda gpu-pack network flower rollout update units buckets

# Audits the committed ledger, which holds real proofs, and shows the report. It builds an auditor's program, without a prover, in the place of the
# whole one: `make build` builds that again.
look:
	@scripts/setup.sh light
	@scripts/look

demo: build
	$(ZK0) demo --rounds $(ROUNDS) --nodes $(NODES)

setup:
	@scripts/setup.sh

build: setup
	$(RUST) cargo build --release --workspace --locked

# Builds `zk0` with `--device cuda` for proving, training and evaluating, and two examples, which measure proofs and training steps. This
# takes a target folder of its own, because the feature changes how much of SP1's dependencies is built. It needs no GPU. CUDA_ARCHS
# chooses the GPUs to build for: see scripts/with-cuda.
cuda: export CARGO_TARGET_DIR := $(CARGO_TARGET_DIR)-cuda
cuda:
	@scripts/setup.sh cuda
	$(RUST) scripts/with-cuda cargo build --release --workspace --locked --features zk0/cuda --bin zk0 --example prove_synthetic --example train_step

# Packs what scripts/gpu-check needs on a rented machine with a GPU (docs/gpu.md), and prints its sizes as a JSON line. 40 MB are too many. The pack
# is zk0-gpu.tar.xz in the folder of `make cuda`.
gpu-pack: cuda
	scripts/gpu-pack $(CARGO_TARGET_DIR)-cuda/release/examples $(CARGO_TARGET_DIR)-cuda/zk0-gpu.tar.xz

# Builds `zk0` with `--device network` for proving, and runs the tests of that against a prover network on this machine. This takes a target
# folder of its own, because the feature changes how much of SP1's dependencies is built. It needs no account, and costs nothing.
network: export CARGO_TARGET_DIR := $(CARGO_TARGET_DIR)-network
network: setup
	$(RUST) cargo build --release --workspace --locked --features zk0/network --bin zk0
	$(RUST) cargo test --release --workspace --locked --features zk0/network --test prover prover_network::

# Builds the container image `zk0`, and tries it as docs/services.md says to run it. This needs Podman, and installs nothing outside the image. The first
# time, all is compiled, which takes as long as the first `make build`. What is compiled stays in Podman's cache for the next time.
image:
	podman build --file packaging/Containerfile --tag zk0 .
	scripts/try-image

# Packs `zk0` as a wheel, tries it in a fresh environment from an empty home, and prints its sizes as a JSON line. The first run installs the tools of
# packaging/wheel/requirements.txt from PyPI into ~/.cache/zk0. The wheel is in ~/.cache/zk0/target/wheel.
wheel: build
	scripts/wheel $(ZK0) $(CARGO_TARGET_DIR)/wheel

# Packs `zk0` as a Debian package with the units of its services, and prints its sizes as a JSON line. Then it installs the package in a container, as
# `make units` does, upgrades it over a running aggregator, and removes it. This needs root, and Debian's packages: 300 MB are fetched. SUITE chooses
# another release of Debian. The package is in ~/.cache/zk0/target/deb. Two minutes.
deb: build
	@scripts/setup.sh deb units
	scripts/deb $(CARGO_TARGET_DIR)/deb
	$(SUDO) env SUITE=$(SUITE) scripts/try-units/run.sh $(CARGO_TARGET_DIR)/deb/zk0_*.deb

# Builds the pages of docs/ as a book for browsers, and prints where it is. Links to other files lead into this clone, or to SOURCE, such as
# https://HOST/OWNER/zk0/blob/main. The first time, mdBook is built, which takes minutes.
book:
	@scripts/setup.sh book
	scripts/book

# Tests the Python package for Flower federations: rounds of a SuperLink and three SuperNodes on this machine, up to the proof. The first run
# installs Flower from PyPI into ~/.cache/zk0.
flower: build
	scripts/test-flower

# Runs every check and test, and says at the end where the time went. The real proof comes last and alone, because it needs the memory for itself.
test:
	scripts/test

# Tests that an argument shows nothing of a sample, with a hundred models.
hiding:
	@scripts/setup.sh guest
	$(RUST) cargo test --release --workspace --locked --test argument hiding:: -- --include-ignored

# Takes each check of the protocol, the argument and the verifier out of a copy of the sources, and fails where no test fails without it. `make test`
# does so for the protocol and the guest alone.
deletions:
	@scripts/setup.sh guest
	$(RUST) cargo test --release --workspace --locked --test tree deletions:: -- --include-ignored --nocapture --test-threads 1

# Carries out each attack of docs/attacks.md, and then once more in a copy of the sources without the defence, where it has to succeed. Prints
# one JSON line for each, and how many of the 17 rows hold. ZK0_ATTACKS="5;13" chooses rows. With the tests built, it took eight minutes on two
# cores on which four others built.
attacks:
	@$(RUST) cargo test --release --workspace --locked --quiet --test system attacks:: -- --ignored --nocapture

# Plays what happens to a network once in months (testkit/tests/drills.txt), with real binaries on loopback: an operator mends it with the commands of
# docs/runbook.md. Prints one JSON line for each event, and fails while one of them is not played.
drills:
	@scripts/setup.sh guest
	@scripts/drills

# Changes what this branch changed in the crates that decide, one small piece at a time, and fails where no test notices. BASE is what the branch is
# compared with.
mutants:
	@scripts/setup.sh mutants
	git diff $(BASE) -- circuits protocol verifier weights >$(CARGO_TARGET_DIR)/mutants.diff
	$(RUST) cargo mutants --in-diff $(CARGO_TARGET_DIR)/mutants.diff --output $(CARGO_TARGET_DIR) --profile release \
		--package zk0-circuits --package zk0-protocol --package zk0-verifier --package zk0-weights

# Checks what a person wants to know between two edits: formatting, warnings, and the tests that need neither a proof nor a network.
quick:
	@scripts/setup.sh lint video
	scripts/lint fmt clippy
	$(RUST) cargo test --release --workspace --locked --lib
	$(RUST) cargo test --release --workspace --locked --test tree structure::

# Checks formatting, warnings, and the licences and known vulnerabilities of dependencies.
lint:
	@scripts/setup.sh lint
	scripts/lint

# Prints the lines that the tests cover, by crate, and fails where the crates that decide have less than 90 %. An hour.
coverage:
	@scripts/setup.sh guest coverage
	scripts/coverage

# Prints the guest's cycles and gas for a claim of each profile and mode, and what each operation takes. It executes the guest, and
# makes no SP1 proof. For the claims of full size it first makes arguments about four and 16 samples, which takes an hour and 10 GB.
cycles: build
	@scripts/setup.sh guest
	$(RUST) circuits/build-guest.sh --budget $(CARGO_TARGET_DIR)/budget
	$(RUST) cargo build --release --workspace --locked --example cycle_budget
	$(ZK0) prover cycles
	$(CARGO_TARGET_DIR)/release/examples/cycle_budget $(CARGO_TARGET_DIR)/budget direct 2 micro
	$(CARGO_TARGET_DIR)/release/examples/cycle_budget $(CARGO_TARGET_DIR)/budget succinct 2 micro

# Proves a claim of 98 M weights in mode `succinct`, from a seed, with a compressed SP1 proof. FULL_SAMPLES chooses the number of samples.
# Run it alone, because it needs 20 GiB of memory. On two cores, four samples took seven minutes for the argument, and 45 minutes for the SP1 proof
# with other work beside it. If it is interrupted, run it again: what is done is kept.
prove-full: build
	$(RUST) cargo build --release --workspace --locked --example prove_synthetic
	$(CARGO_TARGET_DIR)/release/examples/prove_synthetic cpu full succinct $(FULL_SAMPLES) $(CARGO_TARGET_DIR)/prove-full-$(FULL_SAMPLES)

# Runs one whole round at the published size: an aggregator, a proving service and two nodes train, prove for real, combine and evaluate, and the
# ledger is audited. Prints a JSON line for each step. Run it alone, because it needs 20 GiB of memory; it also takes 20 GB of disk. If it is
# interrupted, run it again: what is done is kept. FULL_SAMPLES chooses the number of samples of a claim.
round-full: build
	@scripts/setup.sh python
	scripts/round-full $(ZK0) $(CARGO_TARGET_DIR)/round-full --samples $(FULL_SAMPLES)

# Measures what mode `succinct` costs at the published size, beside the SP1 proof: the native argument, the verifier's checks, guest cycles. Then it
# makes an argument about one sample with this build and with that of 88986e74, phase by phase. Prints JSON lines. A quarter of an hour, 10 GB of
# memory, and 3 GB of disk where temporary files go.
bench-succinct: build
	$(RUST) cargo build --release --workspace --locked --example bench_succinct
	$(CARGO_TARGET_DIR)/release/examples/bench_succinct full 4
	scripts/bench-succinct

# Compares fixed-point with float32 losses, untrained and trained, up to the published size, and prints every range. Four minutes
# and 4.4 GB.
fidelity: build
	$(ZK0) fidelity --lerobot tests/fixtures/smolvla_tiny --profile micro --profile full --ranges \
		tests/fixtures/datasets/so100_pickplace tests/fixtures/datasets/so100_stacking tests/fixtures/datasets/so101_pickplace

# Measures how often updates of different origin pass a claim's test, for several numbers of samples, beside a plain comparison of losses.
# Prints JSON lines, and draws docs/samples.svg. Five minutes. CONFIDENCE chooses another confidence than 99%.
power: setup
	$(RUST) cargo build --release --workspace --locked --example power
	$(CARGO_TARGET_DIR)/release/examples/power $(CONFIDENCE) docs/samples.svg docs/samples.jsonl

# Measures appends and replay of the ledger and an aggregator's start beside RocksDB, SHA-256 and ed25519 alone, and the SP1 proofs that are
# verified in a second. Prints JSON lines. Nine minutes, and 4 GB of disk where temporary files go.
bench-ledger: setup
	$(RUST) cargo build --release --workspace --locked --example bench_ledger --example bench_start
	$(CARGO_TARGET_DIR)/release/examples/bench_ledger

# Makes the history of a year, 8,760 rounds of 100 nodes without proofs, and measures on it the start of an aggregator, from its kept state (at a tenth
# of the year, too) and without, and the audit of one more day: entries, rules and signatures. Prints JSON lines; the peer of a figure is its aim. The
# best case is measured, without a bucket, a log server or witnesses: nothing is new after the kept state, except in `years_start_kept_most_new`, with
# 4,095 new entries. Half an hour, and 5 GB of disk where temporary files go. ROUNDS makes another number of rounds.
bench-years: ROUNDS = 8760
bench-years: setup
	$(RUST) cargo build --release --workspace --locked --example bench_ledger --example bench_start
	$(CARGO_TARGET_DIR)/release/examples/bench_ledger years $(ROUNDS)

# Measures the memory and the disk that a node needs for a recording of 50 episodes of 400 frames, at `micro` with all frames and at the
# published size with a few. Prints JSON lines. Ten minutes, and 6 GB of disk where temporary files go.
bench-recording: setup
	$(RUST) cargo build --release --workspace --locked --example bench_recording
	$(CARGO_TARGET_DIR)/release/examples/bench_recording

# Averages 16 updates of the published size from their files, ours beside Flower's. Prints JSON lines. Two minutes, 13 GiB of memory for
# Flower, and 3.4 GB of disk where temporary files go. UPDATES chooses another number of them.
bench-fedavg: setup
	scripts/bench-fedavg/run.sh $(UPDATES)

# Measures an aggregator under load, on loopback: a round of 1,300 nodes, honest nodes beside 2,300 connections that do harm, 16 updates of
# 400 MB at once, one of 200 MB from far away, and what `--presigned-uploads` saves. Prints JSON lines. 13 GB of disk where temporary files go, and
# 4 GB of memory.
bench-load: build
	@scripts/setup.sh guest
	$(RUST) cargo build --release --workspace --locked --example bench_load --example bench_presigned
	$(CARGO_TARGET_DIR)/release/examples/bench_load round 1300
	$(CARGO_TARGET_DIR)/release/examples/bench_load crowd
	$(CARGO_TARGET_DIR)/release/examples/bench_load uploads 16 400
	$(CARGO_TARGET_DIR)/release/examples/bench_load distance 200
	$(CARGO_TARGET_DIR)/release/examples/bench_presigned $(ZK0) 4 400

# Simulates small federations, ours beside Flower's simulation engine: softmax regressions of 10 and 100 nodes, and updates that do nothing.
# Prints JSON lines. The first run installs Flower and Ray into ~/.cache/zk0.
bench-simulate: setup
	scripts/bench-simulate/run.sh

# Compares our training steps of SmolVLA with LeRobot's on PyTorch. Twenty minutes on a machine that does nothing else; see the
# script.
bench-train:
	scripts/bench-train/run.sh

# Reads the pictures of 640x480 recordings in H.264, AV1 and HEVC, beside LeRobot's reader. Prints JSON lines. The first run installs LeRobot into
# ~/.cache/zk0 and records for some minutes; see the script.
bench-decode:
	scripts/bench-decode/run.sh

# Trains a small policy on demonstrations in a simulator, takes it out of a ledger, and lets it drive a simulated SO-101 (docs/rollout.md). The first run
# installs LeRobot, PyTorch and MuJoCo into ~/.cache/zk0, which takes 9 GB where PyTorch's own index cannot be reached.
rollout: build
	@scripts/setup.sh python rollout
	scripts/rollout/example.sh $(ZK0) $(CARGO_TARGET_DIR)/rollout

# Starts the systemd units of packaging/ in a container with a Debian and a systemd of its own, by the commands of docs/services.md, and restarts the
# container. It needs root, 20 GiB of free memory (the proving service refuses to start with less), and Debian's packages: 300 MB are fetched. That is why
# `make test` does not do it. SUITE chooses another release of Debian. Five minutes.
units: build
	@scripts/setup.sh units
	$(SUDO) env SUITE=$(SUITE) scripts/try-units/run.sh $(ZK0)

# Updates a network by docs/governance.md with two releases: this one, and one with other guest programs, which is built of HEAD. The proofs are real, so
# that this needs 20 GiB of memory; see the script.
update: build
	@scripts/setup.sh guest
	scripts/try-update

# Rebuilds the guest programs and their verifying keys from source.
guest:
	@scripts/setup.sh guest
	$(RUST) circuits/build-guest.sh
	$(RUST) cargo build --release --workspace --locked --example record_guest
	$(CARGO_TARGET_DIR)/release/examples/record_guest

# Keeps the blobs of a network in an emulator of Azure's stores, publishes its log there, and lets nodes put updates there. Prints one line for each
# step. The first run installs the emulator from npm into ~/.cache/zk0. `scripts/try-buckets ADDRESS` does so with a bucket of yours.
buckets: setup
	scripts/try-buckets

# Runs a demo, and puts its ledger and a proof into tests/fixtures, and its picture into docs. Do this whenever the guest programs change.
fixtures: build
	scripts/renew-fixtures.sh $(ZK0)
