"""Makes a co-simulation FMU of a first-order motor, in FMI 2.0 or 3.0, from C."""

import re
import subprocess
import zipfile
from importlib.util import find_spec
from pathlib import Path

_TOKEN = "{f0a5b6d2-first-order-motor}"

_MODEL = r"""
#include <math.h>
#include <stdlib.h>

enum { GAIN, LAG, FAIL_AT, VOLTAGE, SPEED, REALS };
enum { RUNNING = 10 };
typedef struct {
    double real[REALS];
    double time;
    void *environment;
    void *logger;
} Motor;

static Motor *motor_new(void) {
    Motor *m = calloc(1, sizeof *m);
    m->real[GAIN] = 10.0;
    m->real[LAG] = 0.1;
    m->real[FAIL_AT] = 1e9;
    return m;
}

static int motor_step(Motor *m, double time, double step) {
    if (time + step / 2 > m->real[FAIL_AT]) return 0;
    double target = m->real[GAIN] * m->real[VOLTAGE];
    m->real[SPEED] = target + (m->real[SPEED] - target) * exp(-step / m->real[LAG]);
    m->time = time + step;
    return 1;
}

static int motor_running(const Motor *m) { return fabs(m->real[SPEED]) > 1.0; }
"""

_FMI2 = r"""
#include "fmi2Functions.h"

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String at,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)at, (void)visible, (void)logging;
    Motor *m = motor_new();
    m->environment = functions->componentEnvironment;
    m->logger = (void *)functions->logger;
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real start,
                               fmi2Boolean d, fmi2Real e) {
    (void)a, (void)b, (void)d, (void)e;
    ((Motor *)c)->time = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return ((Motor *)c)->real[LAG] > 0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { (void)c; return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) v[i] = ((Motor *)c)->real[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) ((Motor *)c)->real[vr[i]] = v[i];
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Boolean v[]) {
    for (size_t i = 0; i < n; i++) v[i] = vr[i] == RUNNING && motor_running(c);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    Motor *m = c;
    (void)keep;
    if (motor_step(m, time, step)) return fmi2OK;
    ((fmi2CallbackLogger)m->logger)(m->environment, "motor", fmi2Error, "error", "winding open");
    return fmi2Error;
}
"""

_FMI3 = r"""
#include "fmi3Functions.h"

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String at, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference wanted[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)at, (void)visible, (void)logging, (void)events, (void)early;
    (void)wanted, (void)n, (void)update;
    Motor *m = motor_new();
    m->environment = environment;
    m->logger = (void *)log;
    return m;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean a, fmi3Float64 b,
                                       fmi3Float64 start, fmi3Boolean d, fmi3Float64 e) {
    (void)a, (void)b, (void)d, (void)e;
    ((Motor *)c)->time = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return ((Motor *)c)->real[LAG] > 0 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3Terminate(fmi3Instance c) { (void)c; return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { (void)c; return fmi3OK; }
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          fmi3Float64 v[], size_t count) {
    (void)count;
    for (size_t i = 0; i < n; i++) v[i] = ((Motor *)c)->real[vr[i]];
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 v[], size_t count) {
    (void)count;
    for (size_t i = 0; i < n; i++) ((Motor *)c)->real[vr[i]] = v[i];
    return fmi3OK;
}
fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          fmi3Boolean v[], size_t count) {
    (void)count;
    for (size_t i = 0; i < n; i++) v[i] = vr[i] == RUNNING && motor_running(c);
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean keep,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last) {
    Motor *m = c;
    (void)keep;
    *event = *terminate = *early = fmi3False;
    *last = time + step;
    if (motor_step(m, time, step)) return fmi3OK;
    ((fmi3LogMessageCallback)m->logger)(m->environment, fmi3Error, "error", "winding open");
    return fmi3Error;
}
"""

_REALS = (
    ("gain", "parameter", "fixed", "10.0"),
    ("lag", "parameter", "fixed", "0.1"),
    ("fail_at", "parameter", "fixed", "1e9"),
    ("voltage", "input", "continuous", "0"),
    ("speed", "output", "continuous", None),
)


def _variables_2() -> str:
    rows = [
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}">'
        + (f'<Real start="{start}"/>' if start else "<Real/>")
        + "</ScalarVariable>"
        for i, (name, causality, variability, start) in enumerate(_REALS)
    ]
    rows.append(
        '<ScalarVariable name="running" valueReference="10" causality="output" '
        'variability="discrete"><Boolean/></ScalarVariable>'
        '<ScalarVariable name="time" valueReference="11" causality="independent" '
        'variability="continuous"><Real/></ScalarVariable>'
    )
    return "".join(rows)


def _variables_3() -> str:
    rows = [
        f'<Float64 name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}"' + (f' start="{start}"/>' if start else "/>")
        for i, (name, causality, variability, start) in enumerate(_REALS)
    ]
    rows.append(
        '<Boolean name="running" valueReference="10" causality="output" variability="discrete"/>'
        '<Float64 name="time" valueReference="11" causality="independent" '
        'variability="continuous"/>'
    )
    return "".join(rows)


def _description(version: str, kind: str, variables: str) -> str:
    if version == "2.0":
        outputs = '<Unknown index="5" dependencies=""/><Unknown index="6" dependencies=""/>'
        return (
            f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" '
            f'modelName="motor" guid="{_TOKEN}"><{kind} modelIdentifier="motor"/>'
            f"<ModelVariables>{variables or _variables_2()}</ModelVariables>"
            f"<ModelStructure><Outputs>{outputs}</Outputs></ModelStructure></fmiModelDescription>"
        )
    outputs = '<Output valueReference="4"/><Output valueReference="10"/>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" '
        f'modelName="motor" instantiationToken="{_TOKEN}">'
        f'<{kind} modelIdentifier="motor"/>'
        f"<ModelVariables>{variables or _variables_3()}</ModelVariables>"
        f"<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )


def _unused(code: str, header: str) -> str:
    """The functions that the standard wants and this model has no use for: they report an error."""
    names = re.findall(r"^#define (fmi[23][A-Z]\w+) +fmi[23]FullName", header, re.MULTILINE)
    missing = [name for name in names if f" {name}(" not in code]
    return "".join(f"int {name}(void) {{ return 3; }}\n" for name in missing)


def make_fmu(
    folder: Path,
    version: str,
    kind: str = "CoSimulation",
    platform: str = "",
    variables: str = "",
) -> Path:
    """Compiles the model with the headers that come with FMPy, and packs the FMU."""
    spec = find_spec("fmpy")
    assert spec is not None
    assert spec.origin is not None
    headers = Path(spec.origin).parent / "c-code"
    source, library = folder / f"motor{version}.c", folder / f"motor{version}.so"
    code = _MODEL + (_FMI2 if version == "2.0" else _FMI3)
    source.write_text(code)
    rest = folder / f"rest{version}.c"
    rest.write_text(_unused(code, (headers / f"fmi{version[0]}Functions.h").read_text()))
    subprocess.run(
        ["gcc", "-shared", "-fPIC", "-O2", f"-I{headers}", source, rest, "-o", library, "-lm"],
        check=True,
    )
    place = platform or ("linux64" if version == "2.0" else "x86_64-linux")
    suffix = ".dll" if platform == "win64" else ".so"
    path = folder / f"motor{version}{kind}{platform}{len(variables)}.fmu"
    with zipfile.ZipFile(path, "w") as fmu:
        fmu.writestr("modelDescription.xml", _description(version, kind, variables))
        fmu.write(library, f"binaries/{place}/motor{suffix}")
    return path
