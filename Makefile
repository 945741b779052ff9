# Étude's two commands: `make demo` sets up, learns a song and plays it; `make test` sets up and runs the tests.

CARGO ?= cargo
PYTHON ?= python3
ETUDE := target/release/etude
# Minutes after which the training stops at the latest.
MINUTES ?= 10
SONG ?= twinkle

.DEFAULT_GOAL := help
.PHONY: help setup build demo pictures wheel lint test test-heavy test-sb3 test-kernel fuzz bench book clean-runs

help:
	@echo "make demo    set up, learn $(SONG) (at most $(MINUTES) minutes), play it, say which page to open"
	@echo "make test    set up and run the tests, those against other libraries too"
	@echo "make lint    format, lints, the code's own documentation, links, circles between files"
	@echo "make setup   fetch MuJoCo into .mujoco/ and say what is missing"
	@echo "make build   the etude command, optimised, at $(ETUDE), and its manual pages in target/man"
	@echo "make wheel   the Python package as a wheel in target/wheels"
	@echo "make bench   speed of simulation, learner and both, in turns with JAX, PyTorch, RoboPianist and others"
	@echo "make test-heavy  every experiment of the paper in its smallest form, rehearsals, and the commands of the book for a robot"
	@echo "make test-sb3  the adapter for Stable-Baselines3, and SBX's DroQ through it (six gigabytes, for a while)"
	@echo "make test-kernel  the robot's drivers on a real kernel's CAN and MIDI, in QEMU (skips with a reason without it)"
	@echo "make book    the documentation as a book in target/book (installs mdBook into .mdbook on first use)"
	@echo "make pictures  the film and the picture of README and book (needs ffmpeg, Chromium, Node.js)"
	@echo "make fuzz    ten minutes of hostile MIDI files"

setup:
	@command -v $(CARGO) >/dev/null || { echo "setup: Rust is missing; install it with rustup (rustup.rs), then run this again"; exit 1; }
	@command -v cc >/dev/null || { echo "setup: a C compiler is missing (Debian, Ubuntu: apt-get install -y build-essential)"; exit 1; }
	@command -v $(PYTHON) >/dev/null || { echo "setup: Python 3 is missing (Debian, Ubuntu: apt-get install -y python3 python3-pip)"; exit 1; }
	@$(PYTHON) scripts/setup.py

build: setup
	$(CARGO) build --release --locked --package etude
	@$(ETUDE) man -o target/man/man1 >/dev/null

wheel: setup
	$(PYTHON) scripts/python_package.py wheel

# A second `make demo` resumes the first one.
demo: build
	@if [ -f runs/demo-$(SONG)/checkpoints/last.safetensors ]; then \
		$(ETUDE) train --resume runs/demo-$(SONG) --minutes $(MINUTES); \
	else \
		$(ETUDE) train $(SONG) --minutes $(MINUTES) --out runs/demo-$(SONG); \
	fi
	$(ETUDE) play $(SONG) --policy runs/demo-$(SONG) --out out/demo-$(SONG)
	$(ETUDE) replay out/demo-$(SONG)

# They agree with the results table, because the shipped policies play.
pictures: build
	cd viewer && npm ci --no-audit --no-fund --loglevel=error
	$(PYTHON) scripts/pictures.py

lint: setup
	$(CARGO) fmt --all --check
	$(PYTHON) scripts/check_imports.py
	$(PYTHON) scripts/check_links.py docs README.md ARCHITECTURE.md
	$(PYTHON) scripts/tables.py check
	@if pkg-config --exists alsa 2>/dev/null; then hardware="--features etude/hardware"; \
	else echo "not checked: --features hardware (Debian, Ubuntu: apt-get install -y pkg-config libasound2-dev)"; fi; \
	set -x; $(CARGO) clippy --workspace --all-targets $$hardware --locked -- -D warnings
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --workspace --no-deps --locked --quiet

test: setup
	$(PYTHON) scripts/python_packages.py
	@if command -v npm >/dev/null; then set -x; cd viewer && npm ci --no-audit --no-fund --loglevel=error; \
	else echo "not checked: the pages in a browser (Debian, Ubuntu: apt-get install -y nodejs npm chromium)"; fi
	ETUDE_PYTHON=$(PYTHON) PYTHONPATH=$(CURDIR)/.python $(CARGO) test --workspace --locked
	$(PYTHON) scripts/python_package.py test

# Tests of whole commands that take minutes each.
test-heavy: setup
	ETUDE_PYTHON=$(PYTHON) PYTHONPATH=$(CURDIR)/.python $(CARGO) test --workspace --test command --locked -- --ignored --skip beside_a_twin
	@# By the wall clock, so alone.
	ETUDE_PYTHON=$(PYTHON) PYTHONPATH=$(CURDIR)/.python $(CARGO) test --workspace --test command --locked -- --ignored beside_a_twin

# Beside the rest of the tests, since PyTorch and JAX take six gigabytes for a while.
test-sb3: setup
	$(PYTHON) scripts/python_package.py sb3

# Debian, Ubuntu: apt-get install -y qemu-system-x86 busybox-static; with libasound2-dev and pkg-config through ALSA too.
test-kernel:
	CARGO=$(CARGO) $(PYTHON) scripts/kernel/test_kernel.py

# The wheel is for SBX in Étude's world, the trace of an episode for mujoco.rollout.
bench: build wheel
	$(CARGO) build --release --locked --package etude-task --example trace
	$(CARGO) build --release --locked --package etude-lab --example bench
	$(PYTHON) benches/run.py

# Compiled once, some minutes; links within the book that lead nowhere are an error.
.mdbook/bin/mdbook:
	$(CARGO) install mdbook --version 0.5.4 --locked --no-default-features --root .mdbook

book: .mdbook/bin/mdbook
	.mdbook/bin/mdbook build docs
	$(PYTHON) scripts/check_links.py docs README.md ARCHITECTURE.md

fuzz:
	cd fuzz && $(CARGO) build --release --target $$(rustc -vV | sed -n 's/host: //p') && mkdir -p corpus/midi artifacts && \
	target/*/release/midi corpus/midi ../crates/music/tests/golden/midi ../crates/music/tests/golden/cases ../songs \
		-max_total_time=600 -max_len=4096 -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 -artifact_prefix=artifacts/

clean-runs:
	rm -rf runs out
