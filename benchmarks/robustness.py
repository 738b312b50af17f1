"""What kills, interrupts, strangers' files and a sweep in parts do to results.

Every command runs in a process forked from this one, so that an attack costs no imports; it is a
process like any other, and is ended by the same signals.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.hostile_files import KINDS, try_kind
from benchmarks.measuring import table
from fvi_cli.__main__ import INTERRUPTED, main
from fvi_cli.config import parse_config
from fvi_cli.errors import FviError
from fvi_cli.storage import list_runs, read_results
from fvi_cli.storage.code import own_code
from fvi_cli.storage.provenance import origin

LADDER = """\
name: quick
problem:
  kind: bagley-torvik
  damping: [{order: 1.5, coefficient: 1.0}]
  forcing: 15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5
  initial: {position: 0.0, velocity: 0.0}
  final_time: 1.0
  exact: t**2.5
method: {bdf: [1, 2, 3], sampling: nodes, degree: 1}
ladder: {steps: [4, 8, 16, 24, 32, 48]}
"""
SWEEP = """\
name: quick
problem: {kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.1}],
          initial: {position: 1.0}, final_time: 1.0, exact: none}
method: {rk: gauss, degree: 2}
ladder: {steps: [4]}
sweep: {problem.stiffness: {from: 1.0, to: 4.0, number: 60}}
"""
LONG = SWEEP.replace("[4]", "[4000]").partition("sweep:")[0]
LONGEST_SECONDS = 120.0
HANG_SECONDS = 10.0
"""A command on a file from a stranger takes no more of a processor: how long it waits for one where
others compute as well says nothing about the file. :data:`LONGEST_SECONDS` end one that sleeps."""

Command = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Attack:
    """A command that is killed.

    Parameters
    ----------
    name
        In words.
    config
        Text of ``quick.yaml``.
    before
        Commands that are carried out first.
    killed
        The command that is killed, and then repeated to its end.
    late
        It is killed behind this part of the time that it takes undisturbed.
    """

    name: str
    config: str
    killed: Command
    before: Sequence[Command] = ()
    late: float = 0.0


RUN = ("run", "quick.yaml", "-q")
SAYING = ("run", "quick.yaml", "-v")
MERGED = ("results/quick.shard-1-of-2.h5", "results/quick.shard-2-of-2.h5")
CLUSTER = "--dask={address}"
ATTACKS = (
    Attack(name="run", config=LADDER, killed=SAYING),
    Attack(name="sweep", config=SWEEP, killed=RUN),
    Attack(name="two workers", config=SWEEP, killed=(*SAYING, "--workers", "2")),
    Attack(name="cluster", config=SWEEP, killed=(*RUN, CLUSTER)),
    Attack(name="consolidation", config=LADDER, killed=RUN, late=0.85),
    Attack(
        name="merge",
        config=SWEEP,
        before=[(*RUN, "--shard", "1/2"), (*RUN, "--shard", "2/2")],
        killed=("merge", *MERGED),
    ),
    Attack(name="convergence", config=LADDER, before=[RUN], killed=("convergence", *RUN[1:])),
    Attack(name="plot", config=LADDER, before=[RUN], killed=("plot", *RUN[1:])),
    Attack(
        name="export",
        config=LADDER,
        before=[RUN],
        killed=("export", "results/quick.h5", "--to", "csv"),
    ),
)


def begin(folder: Path, command: Command, most_seconds: float = math.inf) -> int:
    """Begin a command in a process of its own; what it prints goes to a file.

    The system ends it when it has taken `most_seconds` of a processor.
    """
    process = os.fork()
    if process:
        return process
    is_begun = False
    try:
        os.setsid()
        # commands behind an ampersand have interrupts ignored, and hand that on
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if math.isfinite(most_seconds):
            # those that it was forked from count for nothing
            own = math.ceil(most_seconds)
            resource.setrlimit(resource.RLIMIT_CPU, (own, own))
        os.chdir(folder)
        log = os.open("log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for number in (1, 2):
            os.dup2(log, number)
        sys.argv = ["fvi", *command]
        is_begun = True
        main()
    except SystemExit as ended:
        sys.stdout.flush()
        os._exit(int(ended.code or 0))
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) and not is_begun:
            os._exit(INTERRUPTED)
        traceback.print_exc()
    os._exit(70)


def end(process: int, seconds: float = 600.0) -> int | None:
    """The exit code of a process, negative for a signal; None if it had to be ended."""
    code, _ = end_of(process, seconds)
    return code


def end_of(process: int, seconds: float = 600.0) -> tuple[int | None, float]:
    """As :func:`end`, and the seconds of a processor that it took."""
    limit = time.monotonic() + seconds
    is_late = False
    while True:
        found, status, used = os.wait4(process, 0 if is_late else os.WNOHANG)
        if found:
            code = None if is_late else os.waitstatus_to_exitcode(status)
            return code, used.ru_utime + used.ru_stime
        if time.monotonic() > limit:
            is_late = True
            os.killpg(process, signal.SIGKILL)
        time.sleep(0.002)


def done(folder: Path, command: Command) -> float:
    """Carry a command out; returns how long it took.

    Raises
    ------
    RuntimeError
        If it does not succeed.
    """
    began = time.monotonic()
    code = end(begin(folder, command), LONGEST_SECONDS)
    if code != 0:
        raise RuntimeError(f"{' '.join(command)}: exit code {code}: {said(folder)}")
    return time.monotonic() - began


def said(folder: Path) -> str:
    """What the last command printed."""
    return (folder / "log").read_text(encoding="utf-8", errors="replace")


def stored(folder: Path) -> set[str]:
    """Every complete run in the files of `folder`, which must all be whole.

    Raises
    ------
    FviError
        If one is not.
    """
    found: set[str] = set()
    files = [*folder.rglob("[!.]*.h5"), *folder.rglob("[!.]*.journal")]
    for path in sorted({one.with_suffix(".h5") for one in files}):
        found |= complete_in(path)
        if path.exists():
            list_runs(path)
    return found


def complete_in(path: Path) -> set[str]:
    """Identities of the runs of a file and of the journal beside it, each verified."""
    with read_results(path, may_be_missing=True) as store:
        return {entry.identity for entry in store.entries() if store.read(entry.identity)}


def files_of(folder: Path) -> set[str]:
    """Names of all files, but those of locks."""
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".lock"
    }


@dataclass(kw_only=True)
class Tally:
    """How often something was done, and what went wrong.

    Parameters
    ----------
    name, count
        What, and how often.
    wrong
        A line for everything that is not as it should be.
    remark
        What else there is to say.
    """

    name: str
    count: int = 0
    wrong: list[str] = field(default_factory=list)
    remark: str = ""


def run_robustness(count: int, seed: int = 0) -> list[Tally]:
    """Attack with `count` in a thousand of the full numbers."""

    def share(full: int) -> int:
        return max(1, full * count // 1000)

    preload()
    tallies: list[Tally] = []
    with tempfile.TemporaryDirectory(prefix="fvi-robustness-") as name, _scheduler() as address:
        folder = Path(name)
        trials: list[functools.partial[Tally]] = [
            *(functools.partial(try_kills, folder, a, share(20), address, seed) for a in ATTACKS),
            functools.partial(try_interrupts, folder, share(50), seed),
            functools.partial(try_reads, folder, share(1000)),
            functools.partial(try_configurations, share(20_000), seed),
            functools.partial(try_files, folder, share(2000), seed),
            *(functools.partial(try_strangers, kind, share(2500), seed) for kind in KINDS),
        ]
        for trial in trials:
            try:
                tallies.append(trial())
            except KeyboardInterrupt:
                break
            except RuntimeError as error:
                name = str(trial.args[1].name) if len(trial.args) == 5 else trial.func.__name__
                tallies.append(Tally(name=name, wrong=[f"could not be tried: {error}"]))
            last = tallies[-1]
            print(last.name, last.count, last.remark, *last.wrong, sep="\n  ", file=sys.stderr)
    return tallies


def preload() -> None:
    """Import what the commands import, once for all of them."""
    for name in (
        "fvi_cli.plotting",
        "fvi_cli.render.figures",
        "fvi_cli.render.json",
        "fvi_cli.render.plans",
        "fvi_cli.render.results",
        "fvi_cli.runner.parts.merge",
        "fvi_cli.runner.compute",
        "fvi_cli.storage.export",
        "matplotlib.backends.backend_agg",
        "matplotlib.backends.backend_pdf",
        "matplotlib.pyplot",
        "rich.table",
    ):
        importlib.import_module(name)
    origin()
    # sources that are edited meanwhile would make strangers of the commands that follow
    own_code()


def robustness_table(tallies: Sequence[Tally]) -> str:
    """The table, and below it what went wrong."""
    rows = [(one.name, str(one.count), str(len(one.wrong)), one.remark) for one in tallies]
    wrong = [f"- {one.name}: {line}" for one in tallies for line in one.wrong]
    heading = (
        "Wrong: something lost, torn, left over, mixed, a traceback, more than "
        f"{HANG_SECONDS:.0f} s of a processor for a file or a configuration from a stranger, "
        f"or {LONGEST_SECONDS:.0f} s altogether. Seconds of a processor are counted where "
        "others may compute as well."
    )
    return "\n".join(
        [
            table(heading, ("what", "times", "wrong", "remark"), rows),
            *wrong,
            *([""] if wrong else []),
        ]
    )


# --- kills and interrupts -------------------------------------------------------------------------


def _fresh(folder: Path, config: str) -> Path:
    shutil.rmtree(folder / "attacked", ignore_errors=True)
    own = folder / "attacked"
    own.mkdir()
    (own / "quick.yaml").write_text(config, encoding="utf-8")
    return own


def try_kills(folder: Path, attack: Attack, times: int, address: str, seed: int | str) -> Tally:
    """Kill a command at random moments and repeat it: nothing is lost, torn or left over."""
    tally = Tally(name=f"kill: {attack.name}")
    chance = random.Random(f"{attack.name} {seed}")  # noqa: S311
    killed = tuple(word.format(address=address) for word in attack.killed)
    undisturbed = []
    # the first is slower than those after it, and would let late kills come too late
    for _ in range(3):
        own = _fresh(folder, attack.config)
        for command in attack.before:
            done(own, command)
        undisturbed.append(done(own, killed))
    seconds = min(undisturbed)
    expected = files_of(own), stored(own)
    interrupted = kept = 0
    while tally.count < times:
        own = _fresh(folder, attack.config)
        for command in attack.before:
            done(own, command)
        before = stored(own)
        process = begin(own, killed)
        time.sleep(seconds * chance.uniform(attack.late, 1.0))
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
        interrupted += end(process) == -signal.SIGKILL
        tally.count += 1
        finished = len(re.findall(r"^quick \S+ N=\d+.*: \w+, error", said(own), re.MULTILINE))
        try:
            between = stored(own)
            done(own, killed)
            after = stored(own)
        except (FviError, OSError, RuntimeError, KeyError) as error:
            tally.wrong.append(str(error))
            continue
        kept += len(between - before)
        if finished > len(between):
            tally.wrong.append(f"{finished} runs were said to be finished, {len(between)} are kept")
        if not before <= between <= after:
            tally.wrong.append("runs that were stored are lost")
        if (files_of(own), after) != expected:
            odd = sorted(files_of(own) ^ expected[0])
            tally.wrong.append(f"not what it is undisturbed: {', '.join(odd) or 'other runs'}")
    tally.remark = f"{interrupted} in the midst; {kept} runs found stored after them"
    return tally


def try_interrupts(folder: Path, times: int, seed: int | str) -> Tally:
    """Interrupt ``run --fresh`` where all runs are stored: none is lost."""
    tally = Tally(name="Ctrl-C in `run --fresh`")
    chance = random.Random(seed)  # noqa: S311
    own = _fresh(folder, LADDER)
    done(own, RUN)
    seconds = done(own, (*RUN, "--fresh"))
    expected, names = stored(own), files_of(own)
    codes = []
    while tally.count < times:
        process = begin(own, (*RUN, "--fresh"))
        time.sleep(seconds * chance.uniform(0.0, 1.0))
        os.kill(process, signal.SIGINT)
        codes.append(end(process))
        tally.count += 1
        # one in the midst of writing leaves the journal to the next command
        odd = sorted(name for name in files_of(own) ^ names if not name.endswith(".journal"))
        if not expected <= stored(own) or odd:
            lost = len(expected - stored(own))
            tally.wrong.append(f"{lost} runs lost; other files: {', '.join(odd) or 'none'}")
        if "Traceback" in said(own):
            tally.wrong.append(said(own).strip().splitlines()[-1])
    tally.remark = f"{codes.count(130)} ended with 130, {codes.count(0)} were over"
    return tally


# --- readers beside writers -----------------------------------------------------------------------


def try_reads(folder: Path, times: int) -> Tally:
    """Read tables of orders beside two writers that alternate two problems in one file."""
    tally = Tally(name="read beside two writers")
    own = _fresh(folder, LADDER.replace("[4, 8, 16, 24, 32, 48]", "[4, 8, 16]"))
    variants = [("--set", f"report.norm={norm}", "--fresh") for norm in ("max", "final")]
    done(own, (*RUN, *variants[0][:2]))
    writers = [
        _repeated(own, [(*RUN, "--wait", *variants[(k + j) % 2]) for j in (0, 1)]) for k in (0, 1)
    ]
    try:
        norms = set()
        while tally.count < times:
            place = own / f"reader-{tally.count % 2}"
            place.mkdir(exist_ok=True)
            source = own / "results" / "quick.h5"
            command = ("convergence", str(source), "-q", "-o", "out")
            code = end(begin(place, command, HANG_SECONDS), LONGEST_SECONDS)
            tally.count += 1
            csv = place / "out" / "tables" / "quick.csv"
            if code != 0 or not csv.exists():
                tally.wrong.append(f"exit code {code}: {said(place)[:200]}")
                continue
            lines = csv.read_text(encoding="utf-8").splitlines()
            column = lines[0].split(",").index("norm")
            found = {line.split(",")[column] for line in lines[1:]}
            norms |= found
            if len(found) != 1 or len(lines) != 1 + 9:
                tally.wrong.append(f"{len(lines) - 1} rows of {', '.join(sorted(found))}")
            csv.unlink()
    finally:
        for process in writers:
            os.killpg(process, signal.SIGKILL)
            os.waitpid(process, 0)
    tally.remark = f"norms seen: {', '.join(sorted(norms))}"
    return tally


def _repeated(folder: Path, commands: Sequence[Command]) -> int:
    """A process that carries out commands for ever."""
    process = os.fork()
    if process:
        return process
    os.setsid()
    parent = os.getppid()
    while os.getppid() == parent:
        for command in commands:
            end(begin(folder, command))
    os._exit(0)


# --- strangers ------------------------------------------------------------------------------------


def try_configurations(times: int, seed: int) -> Tally:
    """Check configurations with changes at random: a complaint or none, nothing else."""
    tally = Tally(name="hostile configurations")
    chance = random.Random(seed)  # noqa: S311
    refused = 0
    slowest = 0.0
    while tally.count < times:
        text = mutated(chance.choice((LADDER, SWEEP, LONG)), chance)
        began = time.process_time()
        try:
            with _alarm(LONGEST_SECONDS):
                parse_config(text, "f.yaml")
        except FviError as error:
            refused += 1
            if not str(error).isprintable() and "\n" not in str(error):
                tally.wrong.append(f"unprintable: {error!r}")
        except Exception as error:
            tally.wrong.append(f"{type(error).__name__}: {error}: {text!r}")
        taken = time.process_time() - began
        if taken > HANG_SECONDS:
            tally.wrong.append(f"{taken:.1f} s of processor time: {text!r}")
        slowest = max(slowest, taken)
        tally.count += 1
    tally.remark = f"{refused} refused; the slowest took {slowest:.1f} s of processor time"
    return tally


_WORDS = """
? ! | > & * - : {} [] [[ }} # % @ ` ' " !!python/object:os.system <<: *a &a null true nan .inf 1e999
-1 0 1e-320 1e308 99999999999999999999 __import__('os') ${HOME} ../../etc/passwd /dev/zero é
problem ladder method sweep experiments accuracy tolerance steps order damping file forcing exact
"""
WORDS = [*_WORDS.split(), "\x00", "\u2028", "\ufeff"]


def mutated(text: str, chance: random.Random) -> str:
    """A text with some of its pieces cut out, doubled, swapped or replaced."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        begin = chance.randrange(len(text) + 1)
        finish = min(len(text), begin + chance.choice((0, 1, 3, 10, 40)))
        new = chance.choice(
            (
                "",
                text[begin:finish] * 2,
                chance.choice(WORDS),
                " ".join(chance.choice(WORDS) for _ in range(3)),
                chance.choice(("\n", "\n  ", "\t", ": ", ", ")),
            )
        )
        text = text[:begin] + new + text[finish:]
    return text


def try_files(folder: Path, times: int, seed: int) -> Tally:
    """Show, tabulate, export and reuse result files with damage."""
    tally = Tally(name="hostile result files")
    chance = random.Random(seed)  # noqa: S311
    own = _fresh(folder, LADDER.replace("[4, 8, 16, 24, 32, 48]", "[4, 8]"))
    done(own, RUN)
    path = own / "results" / "quick.h5"
    content = path.read_bytes()
    commands = (
        ("show", "results/quick.h5"),
        ("convergence", "results/quick.h5", "-q"),
        ("export", "results/quick.h5", "--to", "npz"),
        ("merge", "results/quick.h5", "-o", "merged"),
        ("run", "quick.yaml", "-q"),
    )
    codes = []
    slowest = (0.0, "none")
    while tally.count < times:
        path.write_bytes(_damaged(content, chance))
        command = chance.choice(commands)
        code, taken = end_of(begin(own, command, HANG_SECONDS), LONGEST_SECONDS)
        codes.append(code)
        slowest = max(slowest, (taken, command[0]))
        tally.count += 1
        told = said(own)
        if code not in (0, 2) or "Traceback" in told or "unexpected" in told:
            tally.wrong.append(f"{command[0]}: exit code {code}, {taken:.1f} s: {told[-200:]}")
        for name in ("merged", "export", "results/tables"):
            shutil.rmtree(own / name, ignore_errors=True)
    seconds, name = slowest
    tally.remark = (
        f"{codes.count(2)} refused; the slowest, {name}, took {seconds:.1f} s of processor time"
    )
    return tally


def try_strangers(kind: str, times: int, seed: int) -> Tally:
    """Read files of matrices, samples and contents that declare what they like."""
    found = try_kind(kind, times, seed)
    return Tally(
        name=f"hostile {kind}",
        count=found.count,
        wrong=found.wrong,
        remark=f"{found.refused} refused; the slowest took {found.slowest:.1f} s of processor time",
    )


def _damaged(content: bytes, chance: random.Random) -> bytes:
    changed = bytearray(content)
    how = chance.randrange(4)
    if how == 0:
        return bytes(changed[: chance.randrange(len(changed))])
    if how == 1:
        # without the seal every structure of the format is open to attack
        del changed[changed.rfind(b"fvi-cli sha256 seal:") :]
    for _ in range(chance.choice((1, 2, 8, 64))):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    def too_long(number: int, frame: object) -> None:
        raise TimeoutError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _scheduler() -> Iterator[str]:
    """A Dask cluster of two workers in processes of its own."""
    script = (
        "import sys; from distributed import Client, LocalCluster\n"
        "if __name__ == '__main__':\n"
        "    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=':0',\n"
        "                      silence_logs=50) as c:\n"
        "        with Client(c) as client:\n"
        "            client.wait_for_workers(2, timeout=120)\n"
        "        print(c.scheduler_address, flush=True); sys.stdin.read()\n"
    )
    with tempfile.NamedTemporaryFile("w", suffix=".py") as file:
        file.write(script)
        file.flush()
        process = subprocess.Popen(  # noqa: S603
            [sys.executable, file.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        with process:
            if process.stdout is None or process.stdin is None:
                raise RuntimeError("no pipes")
            yield process.stdout.readline().strip()
            process.stdin.close()
            process.wait(60)
