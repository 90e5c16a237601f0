"""A driver that was written for a real IMU440, unmodified, on the virtual unit: whether it finds it, and what it reads.

    python benchmarks/imu440_driver.py --xbow440 DIR --serial DIR [--seconds 5]

Nothing is downloaded. It needs g++, Boost (on Debian libboost-thread-dev and libboost-date-time-dev) and two source
trees: of https://github.com/GAVLab/xbow440 (at 88478c6c), and of the library that it is built on,
https://github.com/wjwwood/serial. The driver looks for the unit with a bare ping, and checks no CRC. It takes what
waits in the port for the answers to its five pings, 1000 bytes each, and a virtual unit's port keeps what nobody has
read: so the unit begins to stream when the driver has been compiled.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import bench
from helpers.units import Still, served

from filters.imu import STANDARD_GRAVITY
from imutui.instrument.uut.unit import VirtualUnit
from imutui.instrument.uut.unit_options import UnitOptions

HARNESS = """
#include <cstdio>
#include <cstdlib>
#include <unistd.h>
#include "xbow440/xbow440.h"

static int packets = 0;
static double sum = 0.0, lowest = 1e9, highest = -1e9;
static void take(const xbow440::ImuData& data) {
    packets += 1;
    sum += data.az;
    if (data.az < lowest) lowest = data.az;
    if (data.az > highest) highest = data.az;
}

int main(int, char** argv) {
    xbow440::XBOW440 imu;
    imu.set_data_handler(take);
    if (!imu.Connect(argv[1], 115200)) return 1;
    sleep(std::atoi(argv[2]));
    std::printf("\\nRESULT %d %.6f %.6f %.6f\\n", packets, sum / packets, lowest, highest);
    std::fflush(stdout);
    _exit(0);
}
"""


def compiled(xbow440: Path, serial: Path, folder: Path) -> Path:
    """The driver with a main function that counts packets."""
    harness, program = folder / "harness.cpp", folder / "harness"
    harness.write_text(HARNESS)
    sources = [harness, xbow440 / "src/xbow440.cpp", serial / "src/serial.cc", serial / "src/impl/unix.cc"]
    missing = [str(path) for path in sources if not path.exists()]
    if missing:
        raise SystemExit(f"not found: {', '.join(missing)}")
    includes = [f"-I{xbow440 / 'include'}", f"-I{serial / 'include'}"]
    libraries = ["-lboost_thread", "-lboost_system", "-lpthread"]
    # newer Boost has notes on what the driver includes, which -w does not turn off
    quiet = ["-w", "-DBOOST_BIND_GLOBAL_PLACEHOLDERS", "-DBOOST_ALLOW_DEPRECATED_HEADERS"]
    subprocess.run(["g++", "-O1", *quiet, *includes, *map(str, sources), *libraries, "-o", str(program)], check=True)
    return program


def main() -> int:
    asked = bench.options(__doc__, xbow440=Path, serial=Path, seconds=5)
    print(bench.describe("numpy"))
    options = UnitOptions()
    unit = VirtualUnit(Still(), options)
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(asked.xbow440, asked.serial, Path(folder))
        limit = asked.seconds + 30
        with served(unit, log=print) as port:
            done = subprocess.run([program, port, str(asked.seconds)], capture_output=True, text=True, timeout=limit)
    print(done.stdout, done.stderr)
    result = [line.split()[1:] for line in done.stdout.splitlines() if line.startswith("RESULT")]
    if not result:
        print("the driver has not found the unit")
        return 1
    count, (mean, lowest, highest) = int(result[0][0]), map(float, result[0][1:])
    true, attempts = 0.998 * STANDARD_GRAVITY, done.stdout.count("Resyncing.")
    print(f"in step after {attempts} of 5 attempts, {count} packets in {asked.seconds} s")
    print(f"z {mean:.4f} m/s^2, {lowest:.4f} to {highest:.4f}, of {true:.4f}")
    return 0 if count > 90 * asked.seconds and max(true - lowest, highest - true) < 0.01 else 1


if __name__ == "__main__":
    sys.exit(main())
