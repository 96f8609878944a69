"use strict";
(() => {
  const MOST = 40;

  function figure(frame) {
    const svg = frame.querySelector("svg");
    const whole = svg.getAttribute("viewBox").split(/\s+/).map(Number);
    const panels = [...svg.querySelectorAll(".panel")].map((element) => ({
      box: element.dataset.box.split(" ").map(Number),
      name: element.dataset.name,
      axes: ["x", "y"].map((side) => axis(element.dataset[side], element.dataset[side + "Label"])),
    }));
    const output = frame.parentNode.querySelector(".reading");
    let view = whole.slice();
    const pointers = new Map();
    let moved = false;

    const shape = whole[2] / whole[3];
    let aspect = shape;

    // a view has the shape of the whole figure, or of a panel that fills it: then the frame is as tall as the window lets it
    function show(next) {
      const width = Math.min(whole[2], Math.max(whole[2] / MOST, next[2]));
      const height = width / aspect;
      const within = (start, size, first, all) => size >= all ? first + (all - size) / 2 : Math.min(first + all - size, Math.max(first, start));
      view = [
        within(next[0] + (next[2] - width) / 2, width, whole[0], whole[2]),
        within(next[1] + (next[3] - height) / 2, height, whole[1], whole[3]),
        width,
        height,
      ];
      svg.setAttribute("viewBox", view.map((part) => part.toFixed(3)).join(" "));
      frame.classList.toggle("near", near());
      frame.classList.toggle("fine", svg.clientWidth > view[2]);
    }
    function back() {
      aspect = shape;
      show(whole);
    }
    const near = () => view[2] < whole[2] * 0.999 || aspect !== shape;

    function at(event) {
      const box = svg.getBoundingClientRect();
      return [
        view[0] + (event.clientX - box.left) / box.width * view[2],
        view[1] + (event.clientY - box.top) / box.height * view[3],
      ];
    }
    function zoom(by, about) {
      const width = Math.min(whole[2], Math.max(whole[2] / MOST, view[2] / by));
      const share = width / view[2];
      show([about[0] - (about[0] - view[0]) * share, about[1] - (about[1] - view[1]) * share, width, view[3] * share]);
    }
    const middle = () => [view[0] + view[2] / 2, view[1] + view[3] / 2];
    const move = (x, y) => show([view[0] + x * view[2], view[1] + y * view[3], view[2], view[3]]);

    function fill(panel) {
      const [x, y, w, h] = panel.box;
      const room = [x - 52, y - 24, w + 62, h + 62];
      aspect = Math.min(shape, Math.max(room[2] / room[3], frame.clientWidth / (0.8 * innerHeight)));
      const width = Math.max(room[2], room[3] * aspect);
      const height = width / aspect;
      show([room[0] + (room[2] - width) / 2, room[1] + (room[3] - height) / 2, width, height]);
      frame.scrollIntoView({ block: "nearest" });
    }
    const under = ([x, y]) => panels.find(({ box }) => x >= box[0] && x <= box[0] + box[2] && y >= box[1] && y <= box[1] + box[3]);

    function read(event) {
      const point = at(event);
      const panel = under(point);
      const shares = panel && [(point[0] - panel.box[0]) / panel.box[2], 1 - (point[1] - panel.box[1]) / panel.box[3]];
      const pixel = view[2] / svg.getBoundingClientRect().width;
      const said = panel ? panel.axes.map((one, k) => one && one(shares[k], pixel / panel.box[2 + k])).filter(Boolean) : [];
      output.textContent = said.length ? `at the pointer: ${said.join(", ")}` : "";
    }

    frame.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== frame) return;
      event.preventDefault();
      zoom(Math.exp(-Math.max(-60, Math.min(60, event.deltaY)) / 200), at(event));
      read(event);
    }, { passive: false });

    frame.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      moved = false;
    });
    frame.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return read(event);
      const now = [event.clientX, event.clientY];
      const box = svg.getBoundingClientRect();
      if (pointers.size === 1) {
        if (!moved && Math.hypot(now[0] - before[0], now[1] - before[1]) < 4) return;
        if (!near()) return;
        if (!moved) frame.setPointerCapture(event.pointerId);
        moved = true;
        frame.classList.add("held");
        move((before[0] - now[0]) / box.width, (before[1] - now[1]) / box.height);
      } else {
        const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
        const span = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
        const about = at({ clientX: (now[0] + other[0]) / 2, clientY: (now[1] + other[1]) / 2 });
        if (span(before) > 0) zoom(span(now) / span(before), about);
        moved = true;
      }
      pointers.set(event.pointerId, now);
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) {
      frame.addEventListener(end, (event) => {
        pointers.delete(event.pointerId);
        frame.classList.remove("held");
        if (end === "pointerleave") output.textContent = "";
      });
    }
    frame.addEventListener("dblclick", (event) => {
      const panel = under(at(event));
      if (near() || !panel || panels.length < 2) return near() ? back() : zoom(2, at(event));
      fill(panel);
    });
    frame.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const panel = /^[1-9]$/.test(event.key) && panels[Number(event.key) - 1];
      const keys = {
        "+": () => zoom(1.4, middle()), "=": () => zoom(1.4, middle()), "-": () => zoom(1 / 1.4, middle()),
        "0": back, "Escape": back,
      };
      if (near()) Object.assign(keys, {
        ArrowLeft: () => move(-0.15, 0), ArrowRight: () => move(0.15, 0), ArrowUp: () => move(0, -0.15), ArrowDown: () => move(0, 0.15),
      });
      const act = panel ? () => fill(panel) : keys[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });

    const tools = frame.parentNode.querySelector(".tools");
    function button(label, said, act) {
      const made = document.createElement("button");
      made.type = "button";
      made.textContent = label;
      made.setAttribute("aria-label", said);
      made.title = said;
      made.addEventListener("click", act);
      tools.append(made);
    }
    new ResizeObserver(() => show(view)).observe(frame);
    button("−", "zoom out", () => zoom(1 / 1.6, middle()));
    button("+", "zoom in", () => zoom(1.6, middle()));
    button("whole", "show the whole figure", back);
    if (panels.length > 1) panels.forEach((panel, k) => button(String(k + 1), `show panel ${k + 1}: ${panel.name}`, () => fill(panel)));
  }

  function axis(words, label) {
    if (!words) return null;
    const [scale, ...rest] = words.split(" ");
    const [low, high, threshold] = rest.map(Number);
    const bend = {
      linear: [(v) => v, (v) => v],
      log: [Math.log10, (v) => 10 ** v],
      symlog: [
        (v) => Math.abs(v) <= threshold ? v / 0.9 : Math.sign(v) * threshold * (1 / 0.9 + Math.log10(Math.abs(v) / threshold)),
        (v) => Math.abs(v) <= threshold / 0.9 ? v * 0.9 : Math.sign(v) * threshold * 10 ** (Math.abs(v) / threshold - 1 / 0.9),
      ],
    }[scale];
    const ends = [bend[0](low), bend[0](high)];
    const value = (share) => bend[1](ends[0] + share * (ends[1] - ends[0]));
    return (share, pixel) => {
      const found = value(share);
      const fine = Math.abs(value(share + pixel / 2) - value(share - pixel / 2));
      const places = Math.max(0, Math.min(12, Math.ceil(-Math.log10(fine))));
      return `${label} ${found.toFixed(places)}`;
    };
  }

  document.querySelectorAll(".frame").forEach(figure);
  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
})();
