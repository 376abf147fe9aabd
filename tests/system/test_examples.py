"""Every example of README.md and docs/ that can run does: databases load without a word of
complaint, commands are accepted. What a block needs and does not have is put around it. Blocks
that no test here runs are in blocks-not-run, each with its reason."""
import os
import re
import struct
import subprocess
import xml.etree.ElementTree as xml

import pytest

from client import ARCH, TOP
from docblocks import FILES, blocks, not_run
from ioc import Ioc
from waiting import until

OURS = re.compile(r"^(s7plc|phoenixplc|modbusplc|drvAsyn|asynSetTrace|drvEtherIP_|etheripC|dbLoadRecords)\w*",
                  re.MULTILINE)
# Blocks that show a syntax, or what is printed: nothing to run.
SHOWN = re.compile(r"^(?!#).*PLCname|^s7plc \w+: |^s7plcAsyn \w+ |modbusInterposeConfig|^\w+Ioc st.cmd"
                   r"|\$\(ADDRESS\)|ip\[:port\]",
                   re.MULTILINE)


def those(wanted):
    return [pytest.param(block.text, id=block.place) for block in blocks() if wanted(block.text)]


@pytest.fixture
def run(tmp_path):
    """run(st.cmd, program) starts the program in a folder that looks like our top folder; it
    ends by itself at the first command that fails. Returns what it printed."""
    for name in ("bin", "dbd", "db"):
        (tmp_path / name).symlink_to(TOP / name)

    def start(lines, program="s7plcIoc", head=True):
        script = tmp_path / "st.cmd"
        text = (f'on error break\ndbLoadDatabase "dbd/{program}.dbd"\n'
                f"{program}_registerRecordDeviceDriver pdbbase\n" if head else "")
        script.write_text(text + lines + "\necho all of it was run\n")
        ended = subprocess.run([f"bin/{ARCH}/{program}", "st.cmd"], cwd=tmp_path, input="exit\n",
                               capture_output=True, text=True, timeout=60,
                               env={k: v for k, v in os.environ.items() if k != "P"} | {"S7PLC": "."})
        return ended.stdout + ended.stderr
    start.folder = tmp_path
    return start


def complaints(log):
    return [line for line in log.splitlines()
            if re.search(r"warning|error|undefined|INP:|OUT:|no PLC|allowed:|not found", line, re.I)
            and not line.startswith((" ", "on error")) and "cannot connect" not in line]


def configures(names):
    return "".join(f's7plcConfigure "{name}", 127.0.0.1, 1, 4096, 1024, 1\n' for name in names)


# --- Databases -----------------------------------------------------------------------------------

def is_database(text):
    return "record(" in text and "..." not in text and "MODBUS_DATA" not in text  # of asyn's modbus


@pytest.mark.parametrize("text", those(is_database))
def test_database(run, text):
    """the database {id} loads, and each link is accepted"""
    ports = set(re.findall(r"@asyn\(([\w-]+)", text))
    if ports and not (TOP / "bin" / ARCH / "s7plcAsynIoc").exists():
        pytest.skip("s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")
    controllers = set(re.findall(r'"EtherIP"\)\s*field\(\w+, +"@([\w-]+) ', text))
    names = set(re.findall(r'"@([\w-]+)[/"]', text)) | {"PLC-of-" + port for port in ports}
    (run.folder / "my.db").write_text(text)
    lines = configures(names) + "".join(f"drvEtherIP_define_PLC {name}, 127.0.0.1:1, 0\n"
                                        for name in sorted(controllers))
    lines += "".join(f"drvAsynS7plcConfigure {port}, PLC-of-{port}\n" for port in ports)
    log = run(lines + 'dbLoadRecords "my.db", "P=MY:"\niocInit',
              "s7plcAsynIoc" if ports else "s7plcIoc")
    assert "all of it was run" in log and not complaints(log), log


# --- Commands ------------------------------------------------------------------------------------

def is_commands(text):
    return OURS.search(text) and not SHOWN.search(text) and not is_database(text) \
        and "..." not in text


def is_loadable(command):
    """Loads a database of ours, not the reader's own."""
    file = re.match(r'dbLoadRecords[ ("]+(?:\$\(S7PLC\)/)?(db/[\w.]+)', command)
    return file and (TOP / file.group(1)).exists()


def command_of(line):
    """The command of a line, without the words of explanation beside it; None: there is none."""
    found = re.match(r"((?:s7plc|phoenixplc|modbusplc|drvAsyn|asynSetTrace|drvEtherIP_|EIP_|etherip)\w*|iocInit|dbLoad\w+)(.*)", line)
    if not found:
        return None
    name, rest = found.groups()
    if re.match(r" {10,}", rest):
        return name
    lead = re.match(r"[ (]*", rest).group()
    rest = re.split(r" {3,}| +#", rest[len(lead):])[0]
    if "onfigure" in name or "ModbusOutput" in name:
        rest = line[len(name) + len(lead):].split("#")[0]
    return f"{name}{lead}{rest}"


@pytest.mark.parametrize("text", those(is_commands))
def test_commands(run, text):
    """the commands {id} are accepted"""
    lines = [c for c in map(command_of, text.splitlines()) if c]
    lines = [c for c in lines if not c.startswith("dbLoad") or is_loadable(c)]
    assert lines, "nothing to run"
    made = set(re.findall(r'(?:s7plc|phoenixplc|modbusplc)Configure[ ("]+([\w-]+)', "\n".join(lines)))
    used = set(re.findall(r's7plc(?:SetOption|Tables|Report|Show|Send|StatsReset|ModbusOutput)[ ("]+([\w-]+)',
                          "\n".join(lines)))
    used |= set(re.findall(r"PLC *= *([\w-]+)", "\n".join(filter(is_loadable, lines))))
    used |= set(re.findall(r'drvAsynS7plcConfigure[ ("]+[\w-]+[", ]+([\w-]+)', "\n".join(lines)))
    program = "s7plcIoc"
    if "phoenix" in text:
        program = "phoenixIoc"
    elif "drvAsyn" in text or "asynSetTrace" in text:
        program = "s7plcAsynIoc"
        if not (TOP / "bin" / ARCH / program).exists():
            pytest.skip("s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")
    # the table of plc-tables.md
    (run.folder / "plant.ptr").write_text(next(b.text for b in blocks() if b.text.startswith("layout ")))
    for port in sorted(set(re.findall(r"asynSetTrace\w+ +([\w-]+)", text))):
        lines.insert(0, f"drvAsynS7plcConfigure {port}, PLC")
        used.add("PLC")
    loads = any(map(is_loadable, lines))
    lines += ["iocInit"] if loads and "iocInit" not in lines else []
    log = run(configures(used - made) + "\n".join(lines), program)
    assert "all of it was run" in log and not (loads and complaints(log)), log


# --- PLC files and displays ------------------------------------------------------------------

def is_plc(text):
    return re.search(r"^(signal|tx|rx|mirror|role|tag) ", text, re.MULTILINE) \
        and not text.startswith("layout ") and not is_database(text)


@pytest.mark.parametrize("text", those(is_plc))
def test_plc(tmp_path, text):
    """plcSim finds nothing wrong in the PLC file {id}"""
    file = tmp_path / "my.plc"
    file.write_text(text if re.search(r"^(in|port|role) ", text, re.MULTILINE)
                    else f"in = 256\nout = 256\n{text}")
    ended = subprocess.run([TOP / "bin" / ARCH / "plcSim", "--check", file], text=True,
                           capture_output=True, timeout=60)
    assert ended.returncode == 0, ended.stdout + ended.stderr


def is_xml(text):
    return text.startswith(("<?xml", "<config"))


@pytest.mark.parametrize("text", those(is_xml))
def test_xml(text):
    """{id} is well-formed XML"""
    xml.fromstring(text.encode())


# --- Blocks that nothing here runs -----------------------------------------------------------------

# What a block can be that is not run here; `test: FILE` is run, or compared, by another test.
CLASSES = {"test": "run, or compared with what is printed, by the test named",
           "pattern": "a syntax, with words for what goes there",
           "drawing": "a picture of bytes, threads or times",
           "output": "what another program prints, or what depends on the machine",
           "foreign": "for a program, a module or a machine that the tests do not have",
           "long": "runs for minutes or hours"}


def is_run(text):
    return any(kind(text) for kind in (is_database, is_commands, is_plc, is_xml))


def listed(block):
    return [row for row in not_run() if row[0] == block.page and block.first.startswith(row[1])]


def test_every_block():
    """each block of the documents is run, or stands in blocks-not-run with a reason"""
    missing = [f"{b.place}: {b.first}" for b in blocks() if not is_run(b.text) and not listed(b)]
    assert not missing, "run it, or say in blocks-not-run why not:\n" + "\n".join(missing)


@pytest.mark.parametrize("row", not_run(), ids=lambda row: f"{row[0]} {row[1]}")
def test_not_run(row):
    """blocks-not-run: {id} is a block that is not run here, with a class and a reason"""
    assert len(row) == 4 and row[3], row
    page, begins, kind, reason = row
    assert kind in CLASSES, f"{kind}: allowed: {' '.join(CLASSES)}"
    found = [b for b in blocks() if b.page == page and b.first.startswith(begins)]
    assert found, "no such block: delete the line"
    assert not all(is_run(b.text) for b in found), "it is run: delete the line"
    if kind == "test":
        text = (TOP / "tests" / reason).read_text()
        name = page.rsplit("/", 1)[-1]
        assert name in text or name.removesuffix(".md") in text, f"{reason} does not know {page}"


# --- README: your own PLC in ten lines ---------------------------------------------------------

def readme_block(after):
    """The indented lines behind this text of README.md."""
    text = (TOP / "README.md").read_text().split(after, 1)[1]
    found = re.search(r"((?:^    .*\n|^\n)+)", text, re.MULTILINE).group(1)
    return re.sub(r"^    ", "", found, flags=re.MULTILINE).strip() + "\n"


def test_readme(run):
    """the ten lines of the README run just as they are written"""
    (run.folder / "my.db").write_text(readme_block("`my.db`:\n"))
    start = readme_block("configure/RELEASE.local` names):\n").strip()
    assert start == f"bin/{ARCH}/s7plcIoc st.cmd"
    log = run(readme_block("`st.cmd`:\n") + "dbl\ns7plcReport", head=False)
    assert not complaints(log), log
    for name in ("MY:TEMP", "MY:DOOR", "MY:SETP", "PLC1 192.168.0.10:2000"):
        assert name in log, log


def test_readme_values(new_peer, new_ioc):
    """and the values of the README's PLC arrive, both ways"""
    peer = new_peer(96, 32)
    configure = [line for line in readme_block("`st.cmd`:\n").splitlines()
                 if line.startswith("s7plcConfigure")][0]
    configure = configure.replace("192.168.0.10, 2000", f"127.0.0.1, {peer.port}")
    db = readme_block("`my.db`:\n").replace("$(P):", "$(P)")
    ioc = new_ioc(configure, db)
    peer.wait_connected()
    peer.send(struct.pack(">8xfB83x", 21.5, 8))
    ioc.wait_value("TEMP", 21.5)
    assert ioc.get("DOOR") == 1
    ioc.put("SETP", 2.5)
    peer.wait_block(struct.pack(">f28x", 2.5))


def test_readme_simulated(new_sim, new_ioc):
    """the README's simulated PLC sends the values of its records, and takes the setpoint"""
    sim = new_sim(readme_block("`my.plc`:\n"))
    configure = [line for line in readme_block("`st.cmd`:\n").splitlines()
                 if line.startswith("s7plcConfigure")][0]
    ioc = new_ioc(configure.replace("192.168.0.10, 2000", f"127.0.0.1, {sim.port}"),
                  readme_block("`my.db`:\n").replace("$(P):", "$(P)"))
    ioc.wait_value("DOOR", 1)
    assert 20 <= ioc.get("TEMP") <= 30
    ioc.put("SETP", 2.5)
    until(lambda: sim.command("get out 0 REAL32").endswith("= 2.5"))


# --- Commands with wrong arguments -----------------------------------------------------------------

WRONG_ELSEWHERE = {
    "s7plcIoc": ["drvEtherIP_define_PLC E", "etheripConfigure E, 127.0.0.1, 300"],
    "s7plcAsynIoc": ["drvAsynS7plcConfigure P, Nemo"],
}
WRONG = [
    "s7plcConfigure PLC", "s7plcConfigure X, 1.2.3.4, port, 8, 8", "s7plcConfigure PLC, 1.2.3.4, 1, 1, 1",
    "s7plcSetOption Nemo scan all", "s7plcSetOption PLC scan some", "s7plcSetOption PLC nothing 1",
    "s7plcReport Nemo", "s7plcReport PLC much", "s7plcShow Nemo", "s7plcShow PLC inside",
    "s7plcTables Nemo x.ptr", "s7plcTables PLC", "s7plcTables PLC none.ptr", "s7plcSend Nemo", "s7plcSend Silent", "s7plcStatsReset Nemo", "s7plcModbusOutput Nemo",
    "modbusplcConfigure M", "phoenixplcConfigure F",
]


@pytest.mark.parametrize("program, line", [(name, line) for name, lines in {"phoenixIoc": WRONG, **WRONG_ELSEWHERE}.items()
                                           for line in lines])
def test_wrong_command(run, program, line):
    """{line}: iocsh knows that it failed, and `on error` works"""
    if not (TOP / "bin" / ARCH / program).exists():
        pytest.skip("s7plcAsyn is not built: ASYN is not set in configure/RELEASE.local")
    log = run('s7plcConfigure "PLC", 127.0.0.1, 1, 8, 8\ns7plcConfigure "Silent", 127.0.0.1, 1, 8, 0\n'
              + line, program)
    assert "all of it was run" not in log, log


# --- The documents among themselves ----------------------------------------------------------

DOCS = TOP / "docs"


def test_index():
    """every page stands in docs/index.md, and each page of the index is there"""
    listed = set(re.findall(r"^([\w/-]+)$", (DOCS / "index.md").read_text(), re.MULTILINE))
    pages = {str(page.relative_to(DOCS))[:-3] for page in FILES[1:]} - {"index"}
    assert listed == pages


def anchors(file):
    """The headings of a page as links name them."""
    text = re.sub(r"^```.*?^```", "", file.read_text(), flags=re.DOTALL | re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")
            for head in re.findall(r"^#+ (.*)$", text, re.MULTILINE)}


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(TOP)))
def test_links(file):
    """each link of {id} leads to a page, and to a heading in it"""
    text = re.sub(r"^```.*?^```", "", file.read_text(), flags=re.DOTALL | re.MULTILINE)
    for path, anchor in re.findall(r"\]\(([^)#:]*)(?:#([^)]*))?\)", text):
        target = (file.parent / path).resolve() if path else file
        assert target.exists(), path
        assert not anchor or anchor in anchors(target), f"{path}#{anchor}"
