"""Tries the drivers on the kernel's own CAN and MIDI, in a small emulated computer.

Neither a hand nor a keyboard nor root is needed: a guest of QEMU boots Debian's stock kernel, makes
a virtual CAN bus and a USB MIDI keyboard out of nothing, and runs
crates/emulators/examples/kernel_probe.rs on them. Without QEMU, busybox or the kernel package it
says why and ends well: a machine that cannot run this test has not failed it.
"""

import gzip
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
INIT = ROOT / "scripts" / "kernel" / "init"
MODULES = [
    "vcan", "can-raw", "configfs", "snd-seq", "snd-seq-midi", "snd-usb-audio", "dummy_hcd", "libcomposite", "usb_f_midi",
]
EXPECTED = ["can-errors", "can-frames", "can-hand", "can-stop", "can-off", "can-down"]
EXPECTED_EACH_WAY = ["keyboard-{}", "keyboard-{}-replug", "keyboard-{}-sensing"]
TIMEOUT_SECS = 300


def skip(reason):
    print(f"SKIP kernel test: {reason}")
    sys.exit(0)


def fail(reason):
    sys.exit(f"FAIL kernel test: {reason}")


def tool(name, package):
    path = shutil.which(name)
    if path is None:
        skip(f"{name} is missing (Debian: apt-get install -y {package})")
    return path


def run(*command, **options):
    return subprocess.run(command, check=True, capture_output=True, text=True, **options).stdout


def kernel_package(cache):
    """The unpacked stock kernel; fetched once by the package client, which checks signatures."""
    try:
        depends = run("apt-cache", "depends", "linux-image-amd64")
        name = re.search(r"Depends: (linux-image-\S+)", depends)
    except (OSError, subprocess.CalledProcessError):
        name = None
    if name is None:
        skip("apt knows no package linux-image-amd64 (Debian on x86_64 has it; try apt-get update)")
    folder = cache / name[1]
    if not folder.is_dir():
        with tempfile.TemporaryDirectory(dir=cache) as scratch:
            try:
                run("apt-get", "download", name[1], cwd=scratch)
                package = next(pathlib.Path(scratch).glob("*.deb"))
                run("dpkg-deb", "-x", str(package), f"{scratch}/kernel")
            except (OSError, subprocess.CalledProcessError, StopIteration) as error:
                skip(f"the package {name[1]} cannot be had: {getattr(error, 'stderr', None) or error}")
            os.rename(f"{scratch}/kernel", folder)
    return folder


def module_files(kernel, busybox):
    """The modules that are needed, each after those that it needs."""
    tree = next((kernel / "lib" / "modules").iterdir())
    if not (tree / "modules.dep").is_file():
        run(busybox, "depmod", "-b", str(kernel), tree.name)
    needs, paths = {}, {}
    for line in (tree / "modules.dep").read_text().splitlines():
        path, _, others = line.partition(":")
        needs[path] = others.split()
        paths[pathlib.PurePath(path).name.split(".ko")[0].replace("_", "-")] = path
    order = []

    def add(path):
        for other in needs[path]:
            add(other)
        if path not in order:
            order.append(path)

    for module in MODULES:
        if (path := paths.get(module.replace("_", "-"))) is not None:
            add(path)
    return [tree / path if not os.path.isabs(path) else kernel / path.lstrip("/") for path in order]


def build_probe():
    """The probe, through ALSA too where its headers are; the way it hears the keyboard."""
    alsa = shutil.which("pkg-config") and subprocess.run(["pkg-config", "--exists", "alsa"]).returncode == 0
    features = ["--features", "hardware"] if alsa else []
    cargo = os.environ.get("CARGO", "cargo")
    command = [cargo, "build", "--locked", "--package", "etude-emulators", "--example", "kernel_probe", *features]
    if subprocess.run(command, cwd=ROOT).returncode != 0:
        fail("the probe does not build (the compiler's message is above)")
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return target / "debug" / "examples" / "kernel_probe", ["raw", "alsa"] if alsa else ["raw"]


def archive_entry(name, mode, data, number):
    """One file of a cpio archive in the format that the kernel unpacks ("newc")."""
    raw = name.encode() + b"\0"
    fields = [number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(raw), 0]
    header = b"070701" + b"".join(b"%08X" % field for field in fields) + raw
    header += b"\0" * (-len(header) % 4)
    return header + data + b"\0" * (-len(data) % 4)


def initramfs(files, folders):
    archive, number = b"", 1
    parents = {str(parent) for name in files for parent in pathlib.PurePath(name).parents}
    for folder in sorted((parents | set(folders)) - {"."}):
        archive += archive_entry(folder, 0o040755, b"", number)
        number += 1
    for name, data in files.items():
        archive += archive_entry(name, 0o100755, data, number)
        number += 1
    return gzip.compress(archive + archive_entry("TRAILER!!!", 0, b"", 0), 1)


def guest_files(probe, ways, modules, busybox):
    files = {"init": INIT.read_bytes(), "bin/busybox": pathlib.Path(busybox).read_bytes()}
    with tempfile.TemporaryDirectory() as scratch:
        stripped = pathlib.Path(scratch) / "probe"
        shutil.copy(probe, stripped)
        if shutil.which("strip"):
            run("strip", str(stripped))
        files["probe"] = stripped.read_bytes()
    for library in re.findall(r"(/\S+) \(0x", run("ldd", str(probe))):
        files[library.lstrip("/")] = pathlib.Path(library).read_bytes()
    if "alsa" in ways:
        for path in pathlib.Path("/usr/share/alsa").rglob("*.conf"):
            files[str(path).lstrip("/")] = path.read_bytes()
    for path in modules:
        files[f"modules/{path.name}"] = path.read_bytes()
    files["modules/order"] = "".join(f"{path.name}\n" for path in modules).encode()
    return files


def boot(qemu, kernel, archive):
    image = next((kernel / "boot").glob("vmlinuz-*"))
    command = [
        qemu, "-accel", "tcg", "-m", "256", "-smp", "1", "-nodefaults", "-no-reboot", "-display", "none",
        "-serial", "stdio", "-kernel", str(image), "-initrd", str(archive),
        "-append", "console=ttyS0 quiet panic=-1",
    ]
    # The serial line is QEMU's standard input too: it must not be the caller's terminal.
    try:
        guest = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=TIMEOUT_SECS)
    except subprocess.TimeoutExpired as error:
        print((error.stdout or b"").decode(errors="replace"))
        fail(f"the guest did not end within {TIMEOUT_SECS} s; its output is above")
    return guest.stdout.decode(errors="replace").replace("\r", "")


def main():
    if sys.platform != "linux" or os.uname().machine != "x86_64":
        skip("it needs Linux on x86_64")
    qemu = tool("qemu-system-x86_64", "qemu-system-x86")
    busybox = tool("busybox", "busybox-static")
    if "not a dynamic executable" not in subprocess.run(["ldd", busybox], capture_output=True, text=True).stderr:
        skip("busybox is not the static one (Debian: apt-get install -y busybox-static)")
    for name, package in [("apt-get", "apt"), ("dpkg-deb", "dpkg"), ("ldd", "libc-bin")]:
        tool(name, package)
    cache = ROOT / "target" / "kernel"
    cache.mkdir(parents=True, exist_ok=True)
    kernel = kernel_package(cache)
    modules = module_files(kernel, busybox)
    probe, ways = build_probe()
    archive = cache / "initramfs.gz"
    archive.write_bytes(initramfs(guest_files(probe, ways, modules, busybox), ["proc", "sys", "dev", "tmp"]))

    start = time.monotonic()
    output = boot(qemu, kernel, archive)
    print(output)
    expected = EXPECTED + [name.format(way) for way in ways for name in EXPECTED_EACH_WAY]
    missing = [name for name in expected if not re.search(rf"^PASS {re.escape(name)}:", output, re.MULTILINE)]
    if missing or not re.search(r"^DONE$", output, re.MULTILINE):
        fail(f"these checks did not pass: {', '.join(missing) or 'the probe did not end well'}; its output is above")
    print(f"PASS kernel test: {len(expected)} checks, {time.monotonic() - start:.1f} s in the guest")


if __name__ == "__main__":
    main()
