"""A reader and evaluator of blobs written from docs/firmware.md alone, in double precision: no code
of calibkit.
"""

import hashlib
import json
import math
import struct
import zlib


class Blob:
    """Inputs, steps, outputs, tables, tolerances and vectors of a blob."""

    def __init__(self, content):
        """Read the bytes."""
        assert content[:4] == b"CALB"
        (length,) = struct.unpack_from("<I", content, 8)
        (bits,) = struct.unpack_from("<H", content, 12)
        n, r = struct.unpack_from("<II", content, 104)
        assert zlib.crc32(content[: length - 4]) == struct.unpack_from("<I", content, length - 4)[0]
        text = content[112 : length - 4].decode("latin-1").partition("\n\n{")[2]
        lines = ("{" + text).rstrip("\n").split("\n")
        assert hashlib.sha256("\n".join(lines).encode()).digest()[:8] == content[16:24]
        listed = [json.loads(line) for line in lines]
        kinds = [(kind, value) for one in listed for kind, value in one.items()]
        self.program = listed[0]["program"]
        self.inputs = [value for kind, value in kinds if kind == "input"]
        self.outputs = [value for kind, value in kinds if kind == "output"]
        self.steps = [(k, x) for k, x in kinds if k not in ("program", "input", "output", "tables")]
        self.pace = self.program.get("pace")
        v = len(self.inputs) + len(self.outputs) + (3 if self.pace else 2)
        letter = {32: "f", 64: "d"}[bits]
        flat = struct.unpack_from(f"<{n + len(self.outputs) + r * v}{letter}", content, 112)
        self.tables, at = {}, 0
        for name, count in listed[-1]["tables"]:
            self.tables[name], at = flat[at : at + count], at + count
        self.allowed, rows = flat[n : n + len(self.outputs)], flat[n + len(self.outputs) :]
        self.rows = [rows[k * v : k * v + v] for k in range(r)]

    def flags(self):
        """Status → bit, in the order of the page."""
        names = [e["beyond"] if e.get("beyond") else e["flag"] for e in self.inputs]
        names += [step.get("flag", "") for _, step in self.steps]
        names += [e["flag"] for e in self.inputs]
        names += self.pace["flags"] if self.pace else []
        return {name: 1 << k for k, name in enumerate(dict.fromkeys(filter(None, names)))}

    def run(self):
        """Outputs and status of each row of vectors."""
        summing = any(k == "limit" and x.get("flag") == "DRIFT_LIMITED" for k, x in self.steps)
        state = State(self)
        for row in self.rows:
            words = {e["name"]: x for e, x in zip(self.inputs, row, strict=False)}
            if not self.pace:
                yield State(self).step(words)
                continue
            updates, elapsed = (round(x) for x in row[len(words) + len(self.outputs) :][:2])
            if summing and not elapsed:
                state = State(self)
            for _ in range(updates):
                found = state.update(words, elapsed) if elapsed else state.step(words)
            yield found


class State:
    """What a chain remembers from update to update."""

    def __init__(self, blob):
        """As after a reset."""
        self.blob, self.kept, self.histories = blob, {}, {}
        self.updates, self.waited, self.before, self.last = 0, 0, {}, None

    def step(self, words):
        """Outputs and status of one step, without the clock."""
        blob, raised, grouped, values, chosen = self.blob, set(), {}, {}, set()
        for entry in blob.inputs:
            x, (low, high) = words[entry["name"]], blob.tables[entry["table"]][:2]
            if entry.get("beyond"):
                values[entry["name"]] = x
                raised |= {entry["beyond"]} if not low <= x <= high else set()
            else:
                values[entry["name"]] = self.bring(x, low, high, entry["flag"], raised)
        for kind, step in blob.steps:
            own = grouped.setdefault(step.get("group", ""), set())
            table = blob.tables.get(step.get("table"), ())
            values[step["name"]] = getattr(self, f"_{kind}")(step, table, values, own, chosen)
        for name in ("", *chosen):
            raised |= grouped.get(name, set())
        self.kept = values
        self.updates += 1
        outputs = [values[output["source"]] for output in blob.outputs]
        bits = blob.flags()
        self.last = outputs, sum(bits[flag] for flag in raised if flag)
        return self.last

    @staticmethod
    def bring(x, low, high, flag, raised):
        """A value brought into limits, and its flag where it was outside."""
        if not low <= x <= high:
            raised.add(flag)
        return min(max(x, low), high)

    def _map(self, step, table, values, raised, _):
        middle, reciprocal, low, high = table
        u = (values[step["source"]] - middle) * reciprocal
        return self.bring(u, low, high, step["flag"], raised)

    def _limit(self, step, table, values, raised, _):
        return self.bring(values[step["source"]], *table, step["flag"], raised)

    def _sum(self, step, _table, values, _raised, _):
        total = 0.0
        for term in step["terms"]:
            c = self.blob.tables[term["table"]] if term["table"] else (1.0,)
            x = values[term["over"]] if term["over"] else 0.0
            part = math.fsum(a * x**k for k, a in enumerate(c))
            total += term["sign"] * part * math.prod(values[name] for name in term["factors"])
        return total

    def _quotient(self, step, _table, values, _raised, _):
        return values[step["numerator"]] / values[step["denominator"]]

    def _memory(self, step, _table, values, _raised, _):
        if self.updates == 0 and step["start"] == "same":
            return values[step["source"]]
        return self.kept.get(step["source"], 0.0)

    def _play(self, step, table, values, _raised, _):
        x = values[step["source"]]
        return min(max(values[step["kept"]], x + table[0]), x + table[1])

    def _slope(self, step, table, values, raised, _):
        history = self.histories.setdefault(step["name"], [])
        history.insert(0, values[step["source"]])
        del history[step["length"] :]
        if len(history) < step["least"]:
            raised.add(step["flag"])
            return 0.0
        width = step["length"] - 1
        row = table[(len(history) - step["least"]) * width :][:width]
        return sum(w * (v - history[0]) for w, v in zip(row, history[1:], strict=False))

    def _select(self, step, _table, values, raised, chosen):
        x = values[step["source"]]
        for case in step["cases"]:
            (threshold,) = self.blob.tables[case["table"]]
            if {1: x >= threshold, -1: x <= -threshold, 0: abs(x) >= threshold}[case["side"]]:
                chosen.add(case["group"])
                return values[case["value"]]
        raised.add(step["flag"])
        return 0.0

    def update(self, words, elapsed):
        """Outputs and status of one call by the clock."""
        pace, bits = self.blob.pace, self.blob.flags()
        starting, interval, jumped = (bits[flag] for flag in pace["flags"])
        length = round(1000 * self.blob.program["interval_s"])
        settled, furthest = self.blob.tables[pace["table"]]
        first = self.updates == 0
        self.waited = length + length // 2 if first else self.waited + elapsed
        count = self.waited // length
        if count == 0:
            return self.last[0], interval
        moved = abs(words[pace["followed"]] - self.before.get(pace["followed"], math.inf))
        late = count > pace["longest"]
        if not first and not late and moved > furthest * count:
            return self.last[0], jumped
        if late and not first:
            for name in pace["lags"]:
                self.kept[name] = 0.0
            self.updates, self.histories = 0, {}
        steps = 1 if late or first else count
        for k in range(1, steps + 1):
            between = {
                name: x if k == steps else self.before[name] + (x - self.before[name]) * k / steps
                for name, x in words.items()
            }
            outputs, status = self.step(between)
        self.before, self.waited = dict(words), self.waited % length
        if not first and (count != 1 or abs(elapsed - length) > length // 8):
            status |= interval
        if self.updates <= settled:
            status |= starting
        self.last = outputs, status
        return self.last
