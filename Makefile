# make run     set up, run the case study in every seat, and write its report
# make test    set up, lint, check types, run the tests
# make page    the base station's page in a browser, alone and against the whole robot
# make prove   the longer proofs: ten runs through ROS, ten minutes of the loop, coverage of codecs and safety, the case study
#              with every drive over vcan and over two CAN controllers, the bus lost in every way
# make bench   how fast this machine runs the loop

VENV := .venv
# Tests that no load can disturb, which run side by side.
TIMELESS := tests/firmware_io tests/kernel tests/hil/devices tests/hil/plants tests/hil/faults tests/node/native \
	tests/node/model tests/node/models tests/node/control tests/node/cycle tests/node/safety tests/node/campaign \
	tests/node/recording tests/node/replay tests/node/support tests/node/supervisor/page tests/node/supervisor/web
READY := $(VENV)/.ready

.PHONY: run test lint page prove coverage bench clean

run: $(READY)
	$(VENV)/bin/segway-ecc case-study

test: $(READY) lint
	$(VENV)/bin/python -m pytest -n 2 --dist loadfile $(TIMELESS)
	$(VENV)/bin/python -m pytest $(TIMELESS:%=--ignore %)

lint: $(READY)
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

page: $(READY)
	$(VENV)/bin/python -m pytest -m browser -n 2 --dist loadfile tests/node/supervisor/page tests/node/supervisor/web
	$(VENV)/bin/python -m pytest -m browser --ignore tests/node/supervisor/page --ignore tests/node/supervisor/web tests/node/supervisor

CARTS := cart-can cart-odrive cart-vesc cart-cia402

prove: $(READY) coverage
	$(VENV)/bin/python -m pytest -m proof --timeout 0 -s
	for cart in $(CARTS); do $(MAKE) prove-$$cart || exit 1; done
	for cart in cart-can cart-odrive cart-vesc; do $(VENV)/bin/segway-ecc failover $$cart --channel $$cart || exit 1; done

# The case study with one drive family, over the kernel's own CAN; on a simulated clock, so that no load disturbs it.
SEAT = $(CURDIR)/$(VENV)/bin/segway-ecc case-study --seat can --lock-step --out /run/study

prove-%: $(READY)
	$(VENV)/bin/python -m hil.kernels.uml --interface vcan0 -- $(SEAT) --robot $* --channel vcan0
	$(VENV)/bin/python -m hil.kernels.qemu --timeout 900 -- $(SEAT) --robot $* --channel can0 --plant-channel can1

# Every line and branch of what turns bytes into values and back, of the guard and of safety.
coverage: $(READY)
	$(VENV)/bin/python -m pytest -q -n 2 --dist loadfile tests/firmware_io tests/node/safety --cov --cov-report=term-missing:skip-covered

bench: $(READY)
	$(VENV)/bin/segway-ecc bench

$(READY): pyproject.toml deploy/setup.sh
	deploy/setup.sh $(VENV)
	touch $@

clean:
	rm -rf $(VENV) out
