"""Test files that try to use the network, run code or never end, given to all readers.

Each bait is read in a separate process. A listener on this machine detects network access; a marker
file detects execution of code in the bait.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import pickle
import socket
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from startrack import shipped

LONGEST = 90.0  # second, time limit of a reader, with the imports of its process
EXAMPLE = shipped("designs/noise_only.toml")
# Prints network access by Python code of the process; the listener sees all other access.
AUDIT = """
import sys
def look(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.sendto"):
        print("NETWORK", event, arguments[-1], flush=True)
sys.addaudithook(look)
"""
COMMAND = AUDIT + "from startrack.cli.main import main; sys.exit(main(sys.argv[1:]))"
READ_STORE = AUDIT + (
    "from pathlib import Path; from startrack.montecarlo.store import Store\n"
    "store = Store(Path(sys.argv[1])); print(store.sessions(), len(store.outcomes()))"
)
KERNEL = AUDIT + "from startrack.earth.terrain.tile import block; print(block(1, 0, 0))"


class Bait(NamedTuple):
    """A file and a process that reads it.

    name         of the kind
    code         code of the process, and its arguments
    environment  additional environment variables
    """

    name: str
    code: str
    arguments: tuple[str, ...]
    environment: dict[str, str] = {}  # noqa: RUF012, never changed


class Kept(NamedTuple):
    """Number of broken promises over the baits."""

    baits: int
    network: int
    foreign_code: int
    hangs: int
    notes: tuple[str, ...]


def promises(quick: bool) -> Kept:
    """Give all baits to their readers."""
    network = code = hangs = count = 0
    notes = list[str]()
    with tempfile.TemporaryDirectory() as name, _listener() as (port, heard):
        folder = Path(name)
        marker = folder / "marker"
        for bait in _baits(folder, port, marker, quick):
            count += 1
            before = len(heard)
            environment = os.environ | {"PYTHONWARNINGS": "ignore"} | bait.environment
            words = [sys.executable, "-c", bait.code, *bait.arguments]
            try:
                done = subprocess.run(
                    words,
                    cwd=folder,
                    env=environment,
                    capture_output=True,
                    text=True,
                    timeout=LONGEST,
                    stdin=subprocess.DEVNULL,
                )
            except subprocess.TimeoutExpired:
                hangs += 1
                notes.append(f"{bait.name}: did not end within {LONGEST:g} s")
                continue
            asked = [line for line in done.stdout.splitlines() if line.startswith("NETWORK")]
            if asked or len(heard) > before:
                network += 1
                notes.append(f"{bait.name}: asked for the network {asked}")
            if marker.exists():
                code += 1
                notes.append(f"{bait.name}: ran code")
                marker.unlink()
            last = done.stderr.strip().rpartition("\n")[2]
            fault = "Traceback" in done.stderr and not last.startswith("ValueError: ")
            if fault or "unexpected" in done.stderr:
                notes.append(f"{bait.name}: {last[:200]}")
    return Kept(count, network, code, hangs, tuple(notes))


@contextmanager
def _listener() -> Iterator[tuple[int, list[str]]]:
    """A port of this machine, and access to it over TCP and UDP."""
    heard, over = list[str](), threading.Event()
    with closing(socket.create_server(("127.0.0.1", 0))) as tcp:
        port = tcp.getsockname()[1]
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as udp:
            udp.bind(("127.0.0.1", port))
            for channel in (tcp, udp):
                channel.settimeout(0.1)

            def listen() -> None:
                while not over.is_set():
                    with suppress(TimeoutError):
                        connection, address = tcp.accept()
                        heard.append(str(address))
                        connection.close()
                    with suppress(TimeoutError):
                        heard.append(str(udp.recvfrom(64)))

            thread = threading.Thread(target=listen, daemon=True)
            thread.start()
            try:
                yield port, heard
            finally:
                over.set()
                thread.join()


class _Marks:
    """An object that writes a marker when it is unpickled."""

    def __init__(self, marker: Path):
        self.marker = marker

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str, str]]:
        return open, (str(self.marker), "w")


def _baits(folder: Path, port: int, marker: Path, quick: bool) -> Iterator[Bait]:
    address = f"http://127.0.0.1:{port}"
    kinds = [_terrain, _tables, _images, _arrays, _stores, _kernels, _kernels_of_spice, _endless]
    for kind in kinds:
        baits = kind(folder, address, marker)
        yield from ([next(baits)] if quick and kind in (_terrain, _tables) else baits)
        if quick and kind is _tables:
            return


def _command(name: str, *words: object) -> Bait:
    return Bait(name, COMMAND, tuple(map(str, words)))


def _terrain(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Rasters that name other files, addresses, or code for pixels."""
    wms = (
        f'<GDAL_WMS><Service name="TMS"><ServerUrl>{address}/${{z}}/${{x}}/${{y}}.png</ServerUrl>'
        "</Service><DataWindow><UpperLeftX>-180</UpperLeftX><UpperLeftY>90</UpperLeftY><LowerRightX>"
        "180</LowerRightX><LowerRightY>-90</LowerRightY><TileLevel>1</TileLevel></DataWindow>"
        "<Projection>EPSG:4326</Projection><BandsCount>1</BandsCount></GDAL_WMS>"
    )
    source = (
        "<SimpleSource><SourceFilename>{}</SourceFilename><SourceBand>1</SourceBand></SimpleSource>"
    )
    vrt = (
        '<VRTDataset rasterXSize="9" rasterYSize="9"><SRS>EPSG:4326</SRS><GeoTransform>0,1,0,0,0,'
        '-1</GeoTransform><VRTRasterBand dataType="Float32" band="1" {}>{}</VRTRasterBand>'
        "</VRTDataset>"
    )
    python = (
        f"<PixelFunctionType>f</PixelFunctionType><PixelFunctionLanguage>Python"
        f"</PixelFunctionLanguage><PixelFunctionCode><![CDATA[\nopen({str(marker)!r}, 'w')\n"
        "def f(*a, **k): pass\n]]></PixelFunctionCode>"
    )
    wcs = f"<WCS_GDAL><ServiceURL>{address}/wcs?</ServiceURL><CoverageName>a</CoverageName>"
    wmts = f"<GetCapabilitiesUrl>{address}/wmts</GetCapabilitiesUrl>"
    texts = {
        "GDAL WMS": wms,
        "GDAL WCS": f"{wcs}</WCS_GDAL>",
        "GDAL WMTS": f"<GDAL_WMTS>{wmts}</GDAL_WMTS>",
        "VRT of an address": vrt.format("", source.format(f"/vsicurl/{address}/a.tif")),
        "VRT with code": vrt.format('subClass="VRTDerivedRasterBand"', python),
        "STAC": f'{{"type": "FeatureCollection", "stac_version": "1.0.0", "links": ["{address}"]}}',
    }
    for name, text in texts.items():
        path = folder / f"{name.replace(' ', '-')}.tif"
        path.write_text(text)
        variables = {"GDAL_VRT_ENABLE_PYTHON": "YES"}
        yield _command(name, "earth", "terrain", path)._replace(environment=variables)
    yield _command("address as a terrain file", "earth", "terrain", f"/vsicurl/{address}/a.tif")


def _tables(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Designs and arguments with an address in place of a file, for all keys that name a file."""
    (folder / "code.py").write_text(f"open({str(marker)!r}, 'w')\n")
    for key in ("catalog.source", "instrument.optics.lens_file", "instrument.optics.psf_file"):
        yield _command(key, "requirements", EXAMPLE, "--set", f"{key}={address}/a.fits")
    for key in ("base", "include"):
        path = folder / f"{key}.toml"
        value = f'"{address}/a.toml"'
        path.write_text(f"{key} = {f'[{value}]' if key == 'include' else value}\n")
        yield _command(key, "requirements", path)
    named = folder / "named.toml"
    named.write_text(f'base = "{EXAMPLE}"\n[campaign]\nsearch = "code:search"\n')
    yield _command("code that a design names", "requirements", named)
    for name in ("solve", "detect", "calibrate", "report", "lens import"):
        yield _command(f"{name} of an address", *name.split(), f"{address}/a.png")


def _images(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Files that decoders recognise as another format by content."""
    begin = {"mkv": b"\x1a\x45\xdf\xa3", "avi": b"RIFF    AVI ", "mp4": b"    ftyp"}
    host = address.removeprefix("http://")
    session = (
        f"\nc=IN IP4 127.0.0.1\r\nt=0 0\r\nm=video {host.rpartition(':')[2]} RTP/AVP 96\r\n"
        "a=rtpmap:96 H264/90000\r\n"
    )
    texts = {
        "playlist": f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{address}/a.ts\n",
        "list of parts": f"ffconcat version 1.0\nfile {address}/a.mkv\n",
        "session": session,
        "SVG": f'<svg xmlns="http://www.w3.org/2000/svg"><image href="{address}/a.png"/></svg>',
        "image magick": f"push graphic-context\nimage over 0,0 0,0 '{address}/a.png'\n",
    }
    for name, text in texts.items():
        for ending, magic in begin.items():
            for head in (b"", magic):
                path = folder / f"{name.replace(' ', '-')}-{len(head)}.{ending}"
                path.write_bytes(head + text.encode())
                if not head or name == "session":
                    yield _command(f"{name} as {ending}", "detect", path)


def _arrays(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Files with pickles where arrays are expected."""
    import numpy as np

    objects = np.array([_Marks(marker), 1], dtype=object)
    path = folder / "flight.npz"
    np.savez(path, images=objects, times=objects)
    marker.unlink(missing_ok=True)
    yield _command("pickle in npz", "compare-flight", EXAMPLE, path)
    for ending in ("fits", "png", "csv", "toml", "sqlite", "ser", "nc"):
        bare = folder / f"pickle.{ending}"
        bare.write_bytes(pickle.dumps(_Marks(marker)))
        command = "requirements" if ending == "toml" else "detect"
        yield _command(f"pickle as {ending}", command, bare)


def _stores(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Views and triggers that run when tables are read or written."""
    from startrack import load_design
    from startrack.montecarlo import Store

    for name, statement in {
        "view": "DROP TABLE sessions; CREATE VIEW sessions AS SELECT 1 AS began, "
        f"writefile('{marker}', 'x') AS origin",
        "trigger": "CREATE TRIGGER t AFTER INSERT ON sessions BEGIN DELETE FROM blocks; END",
        "extension": f"CREATE VIEW v AS SELECT load_extension('{marker}')",
    }.items():
        path = folder / f"{name}.sqlite"
        Store(path, load_design(EXAMPLE).case, 1).close()
        with closing(sqlite3.connect(path)) as base:
            base.executescript(statement)
        yield Bait(f"{name} in a store", READ_STORE, (str(path),))


def _kernels(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Compiled code with the right hash that another user of the group could write."""
    cache = folder / "kernels"
    environment = {"NUMBA_CACHE_DIR": str(cache)}
    warm = Bait("kernels of a user", KERNEL, (), environment)
    yield warm
    for mode, name in ((0o664, "group"), (0o666, "others")):
        for path in cache.rglob("*.nbc"):
            data = pickle.dumps(_Marks(marker))
            place = os.path.join(path.parent.name, path.name)
            # Hash as in the package: name and contents of the file.
            cached = os.path.join(os.path.basename(path.parent), path.name)
            digest = hashlib.sha256(cached.encode() + b"\0" + data).digest()
            assert place == cached
            path.write_bytes(data + digest)
            path.chmod(mode)
        yield Bait(f"compiled code that {name} can write", KERNEL, (), environment)


def _kernels_of_spice(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Text kernels that name other files, given as orbit, attitude and clock."""
    text = "KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( '/etc/passwd' )\n\\begintext\n"
    mission = shipped("missions/sun-synchronous.toml")
    for ending, keys in {"bsp": ("orbit.oem",), "bc": ("attitude.aem", "attitude.law")}.items():
        path = folder / f"meta.{ending}"
        path.write_text(text)
        path.with_suffix(".tsc").write_text(text)
        words = [f"{keys[0]}={path}", *(f"{key}=aem" for key in keys[1:])]
        options = [option for word in words for option in ("--set", word)]
        yield _command(f"meta-kernel as {ending}", "mission", mission, *options)


def _endless(folder: Path, address: str, marker: Path) -> Iterator[Bait]:
    """Files without an end, and a few bytes that unpack to more than the memory limit."""
    fifo = folder / "fifo.fits"
    os.mkfifo(fifo)
    readers = {
        "detect": (),
        "solve": (),
        "calibrate": (),
        "requirements": (),
        "lens import": (),
        "earth terrain": (),
        "report": (),
    }
    for name in readers:
        yield _command(f"{name} of a FIFO", *name.split(), fifo)
        yield _command(f"{name} of a device", *name.split(), "/dev/zero")
    bomb = folder / "bomb.fits.gz"
    with gzip.open(bomb, "wb", compresslevel=9) as file:
        for _ in range(64):
            file.write(b"\0" * 2**20)
    yield _command("gzip bomb", "detect", bomb, "--memory", "512M")
    for number in range(9):
        below = ", ".join([f'"many{number + 1}.toml"'] * 10)
        (folder / f"many{number}.toml").write_text(f"include = [{below}]")
    (folder / "many9.toml").write_text("")
    yield _command("includes of includes", "requirements", folder / "many0.toml")
    loop = folder / "loop.toml"
    loop.symlink_to(loop)
    yield _command("link to itself", "requirements", loop)
    deep = folder / "deep.toml"
    deep.write_text("a = " + "[" * 100_000 + "]" * 100_000)
    yield _command("deep lists", "requirements", deep)
