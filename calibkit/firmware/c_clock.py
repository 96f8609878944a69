"""The functions by which a chain with memory keeps time: an update so many milliseconds after the
call before, gaps bridged, jumps left out, and its output between two updates.
"""

from collections.abc import Sequence

from calibkit.firmware.c_steps import Home
from calibkit.firmware.chain import Pace
from calibkit.firmware.export import FirmwareRun
from calibkit.firmware.formats import Format

UPDATE = """@head
{
    uint32_t first = 0U;
    uint32_t status = @P_OK;
    uint32_t count;

    if (state->updates == 0U) {
        first = 1U;
        state->waited_ms = @P_INTERVAL_MS + (@P_INTERVAL_MS / 2U);
    } else if (elapsed_ms > (UINT32_MAX - state->waited_ms)) {
        state->waited_ms = UINT32_MAX;
    } else {
        state->waited_ms += elapsed_ms;
    }
    count = state->waited_ms / @P_INTERVAL_MS;
    if (count != 0U) {
@kept    }
    if (@invalid) {
        status = @P_INVALID;
    } else if (count == 0U) {
        status = @P_INTERVAL;
    } else if ((first == 0U) && (count <= @P_LONGEST) && (@p_jumped(@passedstate, in, count) != 0U)) {
        status = @P_JUMPED;
    } else {
        const uint32_t steps = (count > @P_LONGEST) ? 1U : count;
        uint32_t k;

@restart        for (k = 1U; k <= steps; k++) {
            @p_in at;

            @p_bridge(&state->in, in, k, steps, &at);
            status = @p_step(@passedstate, &at);
        }
        if ((first == 0U) && ((count != 1U) || (elapsed_ms < @P_EARLIEST_MS) || (elapsed_ms > @P_LATEST_MS))) {
            status |= @P_INTERVAL;
        }
@starting        if (first != 0U) {
@began        }
@used        state->waited_ms %= @P_INTERVAL_MS;
    }
@out    return status;
}
"""
BETWEEN = """void @p_between(const @p_state *state, uint32_t elapsed_ms, @p_out *out)
{
    const uint32_t passed = (elapsed_ms < @P_INTERVAL_MS) ? elapsed_ms : @P_INTERVAL_MS;
    const @type share = (@type)passed / (@type)@P_INTERVAL_MS;
@outputs
}
"""


def render(export: FirmwareRun, home: Home, head: str, invalid: str) -> str:
    """Functions that keep time; `head` is that of the update, `invalid` what no number is."""
    structure = export.structure
    pace = structure.pace
    assert pace is not None  # noqa: S101 (a chain with memory that is exported keeps time)
    number = export.program.format
    restart, starting = "", ""
    if not structure.summing:
        lines = ["state->updates = 0U;", *(f"state->{k} = {number.text(0.0)};" for k in pace.lags)]
        restart = _block("if (count > @P_LONGEST) {", lines)
    if pace.lags:
        condition = f"if (state->updates <= (uint32_t){home.tables}{pace.table}[0]) {{"
        starting = _block(condition, ["status |= @P_STARTING;"])
    update = UPDATE.replace("@head", head).replace("@invalid", invalid)
    update = update.replace("@passed", home.passed)
    update = update.replace("@restart", restart).replace("@starting", starting)
    fields = [entry.name for entry in structure.inputs]
    outputs = [output.name for output in structure.outputs]
    copied_outputs = _copied("state->before.", "state->last.", outputs)
    update = update.replace("@kept", _indented(copied_outputs, 8))
    update = update.replace("@began", _indented(copied_outputs, 12))
    update = update.replace("@used", _indented(_copied("state->in.", "in->", fields), 8))
    update = update.replace("@out", _indented(_copied("out->", "state->last.", outputs), 4))
    interpolated = []
    for name in outputs:
        before, last = f"state->before.{name}", f"state->last.{name}"
        interpolated.append(f"out->{name} = {before} + (({last} - {before}) * share);")
    between_function = BETWEEN.replace("@type", number.c_type)
    between_function = between_function.replace("@outputs\n", _indented(interpolated, 4))
    return "\n".join(
        [_jumped(export, home, pace), _bridge(number, fields), update, between_function]
    )


def defines(export: FirmwareRun) -> str:
    """Constants of the clock."""
    structure = export.structure
    if structure.pace is None:
        return ""
    interval = structure.interval_ms
    return (
        f"#define @P_EARLIEST_MS {interval - interval // 8}U\n"
        f"#define @P_LATEST_MS {interval + interval // 8}U\n"
        f"#define @P_LONGEST {structure.pace.longest}U /* intervals that are bridged */\n"
    )


def _indented(lines: Sequence[str], width: int) -> str:
    """Lines of C at an indentation."""
    return "".join(f"{' ' * width}{line}\n" for line in lines)


def _copied(to: str, source: str, names: Sequence[str]) -> list[str]:
    """Statements that copy fields one by one: of a struct, a compiler may call memcpy."""
    return [f"{to}{name} = {source}{name};" for name in names]


def _block(head: str, lines: Sequence[str]) -> str:
    """Statements under a condition, within a branch."""
    return _indented([head, *(f"    {line}" for line in lines), "}"], 8)


def _jumped(export: FirmwareRun, home: Home, pace: Pace) -> str:
    """Function that tells a jump of the followed input."""
    kind = export.program.format.c_type
    return f"""/* whether the input moved further than so many intervals allow */
static uint32_t @p_jumped({home.declared}const @p_state *state, const @p_in *in, uint32_t count)
{{
    const {kind} away = in->{pace.followed} - state->in.{pace.followed};
    const {kind} most = {home.tables}{pace.table}[1] * ({kind})count;

    return ((away < -most) || (away > most)) ? 1U : 0U;
}}
"""


def _bridge(number: Format, fields: Sequence[str]) -> str:
    """Function that gives the inputs of one of several intervals."""
    kind = number.c_type
    lines = [f"const {kind} share = ({kind})k / ({kind})count;", ""]
    lines += [
        f"in->{name} = from->{name} + ((to->{name} - from->{name}) * share);" for name in fields
    ]
    return f"""/* inputs of the k-th of count intervals, in a straight line */
static void @p_bridge(const @p_in *from, const @p_in *to, uint32_t k, uint32_t count, @p_in *in)
{{
    if (k < count) {{
{_indented(lines, 8)}    }} else {{
{_indented(_copied("in->", "to->", fields), 8)}    }}
}}
"""
