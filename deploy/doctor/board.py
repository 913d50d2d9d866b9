"""The computer itself: memory, temperature, and power."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import System, Workload

_THROTTLED: Final = "/sys/devices/platform/soc/soc:firmware/get_throttled"
_CONDITIONS: Final = {0: "under-voltage", 1: "clock rate capped", 2: "throttled", 3: "soft temperature limit"}
"""Of the Raspberry Pi's firmware; 16 bits higher the same since it was switched on."""
_SINCE_START: Final = 16
_HOT_MILLI_C: Final = 80_000
_LITTLE_MIB: Final = 256
_TOO_LITTLE_MIB: Final = 64


def check_board(machine: System, _workload: Workload) -> Iterator[Finding]:
    """Memory everywhere; temperature and power where the machine tells."""
    yield _memory(machine)
    yield from _temperature(machine)
    yield from _raspberry_pi(machine)


def _memory(machine: System) -> Finding:
    lines = (machine.read("/proc/meminfo") or "").splitlines()
    sizes = {name: int(rest.split()[0]) // 1024 for name, _, rest in (line.partition(":") for line in lines) if rest}
    if "MemAvailable" not in sizes:
        return good("memory", "the kernel does not tell")
    free, found = sizes["MemAvailable"], f"{sizes['MemAvailable']} of {sizes.get('MemTotal', 0)} MiB are free"
    remedy = "end what takes it: ps aux --sort=-rss | head; or a computer with more"
    if free < _TOO_LITTLE_MIB:
        return bad("memory", found, "the kernel ends programs, the robot's among them", remedy)
    if free < _LITTLE_MIB:
        return warning("memory", found, "ROS and the recorder take about 200 MiB", remedy)
    return good("memory", found)


def _temperature(machine: System) -> Iterator[Finding]:
    texts = machine.read_all("/sys/class/thermal/thermal_zone*/temp").values()
    values = [int(text) for text in texts if text.lstrip("-").isdecimal()]
    if not values:
        return
    found = f"{max(values) / 1e3:.0f} degrees Celsius"
    if max(values) < _HOT_MILLI_C:
        yield good("temperature", found)
    else:
        yield warning(
            "temperature", found, "the processor is soon made slower to cool it", "a heat sink, a fan, or less to do"
        )


def _raspberry_pi(machine: System) -> Iterator[Finding]:
    text = machine.read(_THROTTLED)
    if text is None:
        return
    name, bits = "Raspberry Pi power", int(text, 16)
    now = _named(bits)
    before = _named(bits >> _SINCE_START)
    remedy = "a supply of the board's rated current with a short cable, and a heat sink; vcgencmd get_throttled"
    if now:
        yield bad(name, f"now: {now}", "the processor is slowed down, or the board about to fail", remedy)
    elif before:
        yield warning(name, f"since it was switched on: {before}", "it will come again under load", remedy)
    else:
        yield good(name, "no under-voltage and no throttling since it was switched on")


def _named(bits: int) -> str:
    return ", ".join(text for bit, text in _CONDITIONS.items() if bits >> bit & 1)
