"""What a model says of its slaves and blocks while it runs, and what it counts; made from C."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from plant_calls import (
    ERROR,
    OP,
    OPERATIONAL,
    SAFEOP,
    STEPS,
    Model,
    Step,
    compile_program,
    run,
    sentence,
)

from conftest import Daemon, names
from ecatd.shm import contract as shm
from ecatsim.control import Simulator

pytestmark = pytest.mark.bus

DIGITAL_INPUTS, DIGITAL_OUTPUTS = 2, 3
SYNC_MANAGER_WATCHDOG = 0x001B

Start = Callable[..., Model]
Program = Callable[[str], Path]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory, troll: Daemon) -> Path:
    """The library for the rig `troll`."""
    folder = tmp_path_factory.mktemp("library")
    troll.ctl("generate", "Plant", str(folder))
    return folder


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory, compiler: str, library: Path) -> Path:
    return compile_program(compiler, STEPS, library, tmp_path_factory.mktemp("steps"))


@pytest.fixture
def program(compiler: str, library: Path, tmp_path: Path) -> Program:
    """A program of its own: the body of its main()."""

    def build(body: str) -> Path:
        main = f'#include "Plant.h"\nint main(int argc, char **argv) {{\n{body}\n}}\n'
        return compile_program(compiler, main, library, tmp_path)

    return build


@pytest.fixture
def model(steps: Path) -> Iterator[Start]:
    """Starts models for a bus."""
    models: list[Model] = []

    def start(
        bus: str,
        *,
        wait_for_bus: bool = False,
        read_only: bool = False,
        require_operational: bool = False,
    ) -> Model:
        numbers = (int(wait_for_bus), ERROR, ERROR, 0, int(read_only), int(require_operational))
        models.append(Model(steps, bus, *map(str, numbers)))
        return models[-1].opened()

    yield start
    for running in models:
        running.close()


def valid(step: Step) -> bool:
    return step.valid


def test_every_bus_cycle_that_a_model_did_not_wait_for_counts(model: Start, troll: Daemon) -> None:
    running = model(troll.bus, wait_for_bus=True, read_only=True)
    first = running.step()
    samples = 0
    # A sample may be of a later cycle than the one that was waited for, where the machine is busy:
    # then the next wait finds that out, and counts it.
    for _ in range(2000):
        step = running.step()
        samples += 1
        if samples % 20 == 0:
            time.sleep(0.01)
    while step.cycle - first.cycle != samples + step.missed - first.missed:
        step = running.step()
        samples += 1
        assert samples < 20000
    assert step.missed - first.missed >= 500  # 100 pauses of 10 cycles, some of them shorter


def test_a_slave_that_leaves_op_is_told_and_so_is_its_return(model: Start, troll: Daemon) -> None:
    running = model(troll.bus)
    running.until(valid)
    with Simulator(str(troll.child_pid("ecatsim"))) as simulator:
        simulator.faults.al_error(DIGITAL_INPUTS, code=SYNC_MANAGER_WATCHDOG)
    step = running.until(lambda step: not step.valid and step.al_state != OP)
    if step.al_state == SAFEOP:
        assert step.al_status_code == SYNC_MANAGER_WATCHDOG
    running.until(valid)
    status, said = running.end()
    assert status == 0
    left, *_, back = said.splitlines()
    place = ("EtherCAT: ", f"slave {DIGITAL_INPUTS} (EL1018)", f"'{troll.bus}'")
    names(left, *place, "not in OP", "not valid")
    names(back, *place, "in OP again")


def test_a_slave_that_leaves_op_ends_a_model_that_requires_it(model: Start, troll: Daemon) -> None:
    running = model(troll.bus, require_operational=True)
    running.until(valid)
    with Simulator(str(troll.child_pid("ecatsim"))) as simulator:
        simulator.faults.al_error(DIGITAL_INPUTS, code=SYNC_MANAGER_WATCHDOG)
    with pytest.raises(AssertionError) as ended:
        running.until(lambda step: False)
    place = (f"slave {DIGITAL_INPUTS} (EL1018)", f"'{troll.bus}'")
    names(ended.value, *place, "not in OP", "requireOperational")


def test_optional_slaves_may_leave_a_model_that_requires_the_others(
    model: Start, start_daemon: Callable[..., Daemon]
) -> None:
    """The terminals of the rig come and go as a group; values are just not valid meanwhile."""
    terminals = {
        2: 0x03FA3052,
        3: 0x07D83052,
        4: 0x0BC03052,
        5: 0x0BC03052,
        6: 0x1A5F3052,
        7: 0x1A5F3052,
    }
    tables = "".join(
        f'[[slave]]\nposition = {n}\nvendor = 2\nproduct = {product}\ngroup = "island"\n'
        for n, product in terminals.items()
    )
    daemon = start_daemon("troll", config=f"[gateway]\nlisten = []\n{tables}")
    running = model(daemon.bus, require_operational=True)
    running.until(lambda step: step.valid and step.state == OPERATIONAL, 1)
    with Simulator(str(daemon.child_pid("ecatsim"))) as simulator:
        simulator.faults.break_link(2)
        running.until(
            lambda step: (
                not step.valid and step.al_state not in (OP, SAFEOP) and step.state == OPERATIONAL
            ),
            1,
        )
        simulator.faults.heal_link(2)
        running.until(lambda step: step.valid and step.input, 1)
    status, said = running.end()
    assert status == 0
    names(said, "slave 2 (EL1018)", "optional", "not valid", "in OP again")


def test_what_a_model_writes_to_a_copied_output_has_no_effect(
    model: Start, start_daemon: Callable[..., Daemon]
) -> None:
    """The block writes channel 1, here a copy of input 2, which is 0. It owns the rest."""
    copy = (
        f'[[copy]]\nslave = {DIGITAL_OUTPUTS}\nentry = "0x7000:01"\n'
        f'from_slave = {DIGITAL_INPUTS}\nfrom_entry = "0x6010:01"\n'
    )
    daemon = start_daemon("troll", config=f"[gateway]\nlisten = []\n{copy}")
    running = model(daemon.bus)
    with daemon.client() as client:
        copied, other = (client.signal(DIGITAL_OUTPUTS, index, 1) for index in (0x7000, 0x7010))
        running.until(lambda _: client.output(other).state == shm.Outputs.ACTIVE, 1)
        assert client.output(copied).state == shm.Outputs.COPIED
    assert not any(running.step(1).input for _ in range(20))
    assert not running.until(valid, 1).input
    assert running.end() == (0, "")


def test_a_model_that_only_watches_runs_beside_one_that_writes(model: Start, troll: Daemon) -> None:
    writer = model(troll.bus)
    writer.until(lambda step: step.input and step.state == OPERATIONAL, 1)
    watcher = model(troll.bus, read_only=True)
    seen = 0
    while seen < 200:
        writer.until(lambda step: step.input, 1)
        step = watcher.step(0)  # wants the output to be 0
        seen += step.input and step.valid
    writer.until(lambda step: step.input, 1)
    for status, said in (watcher.end(), writer.end()):
        assert status == 0
        assert "outputs" not in said  # of lost ones, or of those of another


def test_a_model_that_only_watches_writes_no_objects(program: Program, troll: Daemon) -> None:
    watcher = program("""
  int state = 0, n;
  void *master = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 0.1, 1, 1, 0, 1, 0, "Lab.master");
  void *sdo = ecatm_sdo_open(master, 0, "", 0x6085, 0, 7, 1, 1, 0, 1, 0, "", "Lab.write");
  for (n = 0; n < 1000 && state != ECATM_SDO_FAILED; n++) {
    ecatm_wait(master, 0.001 * n);
    state = ecatm_sdo_write_integer(sdo, 0.001 * n, 0, 1, 4711);
  }
  ecatm_master_close(master);
  return state == ECATM_SDO_FAILED ? 0 : 5;""")
    done = run(watcher, troll.bus)
    assert done.returncode == 0
    assert done.stderr == (
        "EtherCAT: Lab.write: writing object 0x6085:00 of slave 0 failed: readOnly of the "
        "EtherCATMaster is true, so the model writes nothing\n"
    )
    with Simulator(str(troll.child_pid("ecatsim"))) as simulator:
        assert simulator.get(0, 0x6085) != 4711


TWO_SLAVES = """
  void *master = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 1, 1, 1, 0, 0, 0, "Lab.master");
  void *domain = ecatm_domain_open(master, 1, "Lab.one");
  void *one = ecatm_slave_open(domain, 3, "", 2, 0x07D83052, 0, "EL2008", "", "generate",
                               "Lab.one");
  void *two = ecatm_slave_open(domain, {other}, "", 2, 0x07D83052, 0, "EL2008", "", "generate",
                               "Lab.two");
  (void)one, (void)two;
"""


def test_sentences_begin_with_the_block(program: Program, troll: Daemon) -> None:
    wrong = program(TWO_SLAVES.format(other=2) + "  return 0;")
    said = sentence(run(wrong, troll.bus))
    assert said.startswith("EtherCAT: Lab.two: ")
    names(said, "slave 2", f"'{troll.bus}'", "EL1018")

    second = program(
        TWO_SLAVES.format(other=3)
        + "  ecatm_commit(one, 0, 0);\n  ecatm_commit(two, 0, 0);\n  return 0;"
    )
    said = sentence(run(second, troll.bus))
    assert said.startswith("EtherCAT: Lab.one: Lab.two: ")
    names(said, "two blocks", "slave 3", f"'{troll.bus}'")

    missing = program("""
  void *master = ecatm_master_open(argv[argc - 1], 0, 0.001, 2, 1, 1, 1, 0, 0, 0, "Lab.master");
  ecatm_domain_open(master, 3, "Lab.one");
  return 0;""")
    said = sentence(run(missing, troll.bus))
    assert said.startswith("EtherCAT: Lab.one: ")
    names(said, "domain 3", "sampleTime", "length 2", "domainID")


def test_two_masters_of_one_model_that_write_the_same(program: Program, troll: Daemon) -> None:
    both = program("""
  static Plant_EL2008 one, two;
  void *first = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 1, 1, 1, 0, 0, 0, "Lab.first");
  void *second = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 1, 1, 1, 0, 0, 0, "Lab.second");
  Plant_EL2008_open(&one, first, 1);
  Plant_EL2008_open(&two, second, 1);
  ecatm_wait(first, 0);
  ecatm_wait(second, 0);
  Plant_EL2008_write(&one, 0, 0);
  Plant_EL2008_write(&two, 0, 0);
  return 0;""")
    said = sentence(run(both, troll.bus))
    names(said, f"slave {DIGITAL_OUTPUTS} (EL2008)", f"'{troll.bus}'", "belongs to")
    names(said, "this program itself")
    assert "end it" not in said


def test_a_master_that_no_block_uses(program: Program, troll: Daemon) -> None:
    alone = program("""
  void *master = ecatm_master_open(argv[argc - 1], 0, 0.001, 1, 0.1, 1, 1, 0, 0, 0, "Lab.bus");
  int n;
  for (n = 0; n < 3; n++) ecatm_wait(master, 0.001 * n);
  ecatm_master_close(master);
  return 0;""")
    done = run(alone, troll.bus)
    assert done.returncode == 0
    (said,) = done.stderr.splitlines()
    assert said.startswith("EtherCAT: Lab.bus: ")
    names(said, "no block", f"'{troll.bus}'", "etherCATMaster")
