# make run     set up, run the case study in every seat, and write its report
# make demo    set up, and show a simulated segway in the browser, to see, push and break; Ctrl-C ends it
# make test    set up, lint, check types, run the tests
# make test-real-time those that run robots in real time, one at a time; what they show is shown in simulated time by make test
# make test-variants  what make test shows once, with every other model, compiler, fault and screen
# make test-kernels   those that need a kernel with CAN, or a PREEMPT_RT kernel and two CAN controllers, in emulated machines
# make page    of all tests, the base station's page in a browser, with a report of its screenshots
# make boot    build the robot's image, boot it, kill and freeze its node, cut its power, update it
# make disk    its bootable disk in QEMU: it boots with ROS, takes updates from this host, is a base station; an hour
# make docs    the documentation as a site, in out/site
# make prove   the longer proofs: ten runs through ROS, ten minutes of the loop, coverage of codecs and safety, every input to
#              a robot that runs, the case study with every drive over vcan and over two CAN controllers or its serial line,
#              the bus lost in every way
# tests/proofs/busy.sh  the case study ten times and the tests three times on a busy machine
# make bench   how fast this machine runs the loop
# make test-compiled, make bench-compiled: the tests of the loop and of the rig, and the bench, with a compiled install

VENV := .venv
READY := $(VENV)/.ready
QUICK := not proof and not image and not variant
VARIANTS := variant and not proof and not image

# Where the environment forbids bytecode, each process that a test starts compiles all it imports, and each worker every test.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run demo test test-real-time test-variants test-kernels test-compiled lint docs page boot disk prove coverage bench bench-compiled clean

run: $(READY)
	$(VENV)/bin/segway-ecc case-study

demo: $(READY)
	$(VENV)/bin/segway-ecc demo

# Only these are collected where a marker is asked for: collecting all takes ten seconds of each worker.
marked = $(shell grep -rl --include='test_*.py' 'mark\.$(1)\b' tests)

# Many tests wait, for a browser, a compiler or ROS, so more run than there are cores; tests/conftest.py orders them.
test: $(READY) lint
	$(VENV)/bin/python -m pytest -m '$(QUICK) and not ros and not real_time and not kernel and not rt_kernel' -n 4 --dist loadfile \
	    --no-loadscope-reorder
	$(VENV)/bin/python -m pytest -m '$(QUICK) and ros and not real_time' -n 4 --dist loadfile $(call marked,ros)

# With nothing beside them: what disturbs a robot decides such a test.
test-real-time: $(READY)
	$(VENV)/bin/python -m pytest -m 'real_time and not proof and not image' $(call marked,real_time)

test-variants: $(READY)
	$(VENV)/bin/python -m pytest -m '$(VARIANTS) and not real_time' -n 4 --dist loadfile --no-loadscope-reorder

# Emulated instruction by instruction, it takes a core for minutes, and anything beside it in real time would be late.
test-kernels: $(READY)
	$(VENV)/bin/python -m pytest -m '(kernel or rt_kernel) and $(QUICK)' $(call marked,kernel) $(call marked,rt_kernel)

# Run from where no sources are.
COMPILED := .venv-compiled
COPY := build/compiled
SOURCES := segway_ecc firmware_io node hil deploy

COMPILED_TESTS := $(addprefix tests/,node/cycle node/safety node/model node/models node/recording node/ros firmware_io hil)

test-compiled: $(COMPILED)/.ready
	cd $(COPY)/away && $(CURDIR)/$(COMPILED)/bin/python -m pytest -n 2 --dist loadfile --ignore tests/hil/kernels \
	    tests/compiled_build.py $(COMPILED_TESTS)

$(COMPILED)/.ready: pyproject.toml deploy/setup.sh deploy/compile.sh $(shell find $(SOURCES) -name '*.py')
	deploy/setup.sh $(COMPILED)
	deploy/compile.sh $(COMPILED)
	mkdir $(COPY)/away && cd $(COPY)/away && ln -s $(addprefix $(CURDIR)/,$(filter-out $(SOURCES) build out,$(wildcard *))) .
	touch $@

lint: $(READY)
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict

page: $(READY)
	SEGWAY_ECC_SCREENSHOTS=$(CURDIR)/out/page $(VENV)/bin/python -m pytest -m 'browser and not proof and not real_time' -n 4 --dist loadfile tests/deploy/station
	SEGWAY_ECC_SCREENSHOTS=$(CURDIR)/out/page $(VENV)/bin/python -m pytest -m 'browser and real_time and not proof' tests/deploy/station
	$(VENV)/bin/python tests/deploy/station/album.py out/page

# The image, built and booted. With proofs of many minutes: make boot PROOFS=
PROOFS := and not proof
boot: $(READY)
	$(VENV)/bin/python -m pytest -m 'image $(PROOFS)' -s tests/deploy

CARTS := cart-can cart-odrive cart-vesc cart-cia402
FD_CARTS := cart-moteus
SERIAL_CARTS := cart-hoverboard

disk: $(READY)
	$(VENV)/bin/python -m pytest -m 'image and proof' -s --timeout 0 tests/deploy/image/test_disk.py tests/deploy/image/test_disk_station.py

prove: $(READY) coverage
	$(VENV)/bin/python -m pytest -m proof --timeout 0 -s
	$(VENV)/bin/segway-ecc prove inputs
	for cart in $(CARTS); do $(MAKE) prove-$$cart || exit 1; done
	for cart in $(FD_CARTS); do $(MAKE) prove-fd-$$cart || exit 1; done
	for cart in $(SERIAL_CARTS); do $(MAKE) prove-serial-$$cart || exit 1; done
	for cart in cart-can cart-odrive cart-vesc; do $(VENV)/bin/segway-ecc prove failover $$cart --channel $$cart || exit 1; done

# The case study with one drive family, over the kernel's own CAN; on a simulated clock, so that no load disturbs it.
SEAT = $(CURDIR)/$(VENV)/bin/segway-ecc case-study --seat can --no-real-time --out /run/study

# The cards of the second machine carry no CAN FD.
prove-fd-%: $(READY)
	$(VENV)/bin/python -P -m segway_ecc.hil.kernels.uml --interface vcan0 -- $(SEAT) --robot $* --channel vcan0

# Without a bus there is none of the kernel's to go over: a simulated line, and one run in real time on a pseudo-terminal.
prove-serial-%: $(READY)
	$(VENV)/bin/segway-ecc case-study --seat can --robot $* --out out/prove/$*

prove-%: $(READY)
	$(VENV)/bin/python -P -m segway_ecc.hil.kernels.uml --interface vcan0 -- $(SEAT) --robot $* --channel vcan0
	$(VENV)/bin/python -P -m segway_ecc.hil.kernels.qemu --timeout 900 -- $(SEAT) --robot $* --channel can0 --plant-channel can1

# Every line and branch of what turns bytes into values and back, of the guard and of safety.
coverage: $(READY)
	SEGWAY_ECC_EXAMPLES=10000 $(VENV)/bin/python -m pytest -q -n 2 --dist loadfile tests/firmware_io tests/node/safety --cov --cov-report=term-missing:skip-covered

bench: $(READY)
	$(VENV)/bin/segway-ecc bench

bench-compiled: $(COMPILED)/.ready
	cd $(COPY)/away && $(CURDIR)/$(COMPILED)/bin/segway-ecc bench --only loops lock-step campaign latency

$(READY): pyproject.toml deploy/setup.sh
	deploy/setup.sh $(VENV)
	touch $@

clean:
	rm -rf $(VENV) $(COMPILED) build out
