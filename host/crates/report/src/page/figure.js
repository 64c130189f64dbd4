"use strict";
// Values on hover and by keys, zoom by dragging, export.
(() => {
  const NS = "http://www.w3.org/2000/svg", SVG = "image/svg+xml";
  const set = (e, attributes) => { for (const k in attributes) e.setAttribute(k, attributes[k]); };
  const el = (name, attributes, parent) => {
    const e = document.createElementNS(NS, name);
    set(e, attributes);
    parent?.append(e);
    return e;
  };
  const power = n => "10" + String(n).replace(/[-0-9]/g, c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
  const group = s => s.replace("-", "−").replace(/^(−?)(\d{5,})/, (_, m, d) => m + d.replace(/\B(?=(\d{3})+$)/g, "\u202f"));
  const number = v => {
    if (v == null) return "–";
    if (v === 0) return "0";
    const a = Math.abs(v), e = Math.floor(Math.log10(a));
    if (a < 1e-3 || a >= 1e5) return group((v / 10 ** e).toFixed(2)) + " · " + power(e);
    return group(v.toFixed(Math.max(0, Math.min(6, 3 - e))));
  };

  // An axis: { lo, hi, log, n: its name, t: names of values }; f runs evenly along it.
  const f = (a, v) => a.log ? Math.log10(v) : v, inverse = (a, t) => a.log ? 10 ** t : t;
  function ticks(a, room) {
    const lo = Math.min(a.lo, a.hi), hi = Math.max(a.lo, a.hi), out = [];
    if (a.t) return a.t.filter(([v]) => v >= lo && v <= hi);
    if (a.log && hi / lo > 5) {
      for (let d = Math.floor(Math.log10(lo)); d <= Math.log10(hi); d++)
        for (const m of hi / lo < 100 ? [1, 2, 5] : [1]) {
          const v = m * 10 ** d;
          if (v >= lo && v <= hi)
            out.push([v, d >= -3 && d < 5 ? group(v.toFixed(Math.max(0, -d))) : (m > 1 ? m + "·" : "") + power(d)]);
        }
      return out;
    }
    const span = hi - lo, p = 10 ** Math.floor(Math.log10(span / room));
    const step = [1, 2, 5, 10].map(m => m * p).find(s => span / s <= room);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = Math.ceil(lo / step - 1e-9); k * step <= hi + 1e-9 * span; k++)
      out.push([k * step, Math.max(Math.abs(lo), hi) < 1e5 && digits < 5 ? group((k * step).toFixed(digits)) : number(k * step)]);
    return out;
  }

  const save = (name, type, data) => {
    const a = document.createElement("a");
    a.href = URL.createObjectURL(data instanceof Blob ? data : new Blob([data], { type }));
    a.download = name;
    a.click();
    setTimeout(() => URL.revokeObjectURL(a.href), 1e4);
  };
  const KEPT = ["fill", "stroke", "stroke-width", "stroke-dasharray", "fill-opacity", "font-size", "font-family", "font-weight", "display"];
  function standalone(svg) {
    const copy = svg.cloneNode(true), to = copy.querySelectorAll("*");
    // All of them are inherited: each element keeps what differs from those around it.
    const kept = (e, to, around) => {
      const s = getComputedStyle(e), own = KEPT.filter(k => s.getPropertyValue(k) !== around?.getPropertyValue(k));
      if (own.length) to.setAttribute("style", own.map(k => `${k}:${s.getPropertyValue(k)}`).join(";"));
    };
    kept(svg, copy);
    svg.querySelectorAll("*").forEach((e, i) => kept(e, to[i], getComputedStyle(e.parentElement)));
    copy.querySelectorAll(".cross").forEach(e => e.remove());
    copy.prepend(el("rect", { width: "100%", height: "100%", fill: getComputedStyle(document.body).backgroundColor }));
    return new XMLSerializer().serializeToString(copy);
  }
  function png(svg, name) {
    const i = new Image(), { width, height } = svg.viewBox.baseVal;
    i.onload = () => {
      const c = Object.assign(document.createElement("canvas"), { width: 3 * width, height: 3 * height });
      c.getContext("2d").drawImage(i, 0, 0, c.width, c.height);
      c.toBlob(b => save(name + ".png", "image/png", b));
    };
    i.src = `data:${SVG},` + encodeURIComponent(standalone(svg));
  }
  const quoted = s => `"${s.replaceAll('"', '""')}"`;
  const csv = m => ["series," + quoted(m.x.n) + "," + quoted(m.y.n) + (m.s.some(s => s.e) ? ",std_error" : "")]
    .concat(m.s.flatMap(s => s.p.map((p, i) => [quoted(s.n), ...p, ...(s.e ? [s.e[i]] : [])].join(",")))).join("\n") + "\n";

  onbeforeprint = () => document.querySelectorAll("details").forEach(d => d.open = true);
  for (const figure of document.querySelectorAll("figure.plot")) {
    const svg = figure.querySelector("svg"), name = figure.dataset.name, m = JSON.parse(figure.querySelector("script").textContent);
    const tools = document.createElement("div"), tip = document.createElement("div");
    tools.className = "tools noprint";
    tip.className = "tip";
    tip.hidden = true;
    figure.append(tools, tip);
    const button = (text, title, act) => {
      const b = Object.assign(document.createElement("button"), { textContent: text, title, onclick: act });
      b.setAttribute("aria-label", title + ": " + name);
      tools.append(b);
      return b;
    };
    button("SVG", "save as SVG", () => save(name + ".svg", SVG, standalone(svg)));
    button("PNG", "save as PNG", () => png(svg, name));
    const points = m.s.flatMap(s => s.p.map((p, i) => ({ s, p, e: s.e?.[i] })));
    if (points.length) button("CSV", "save as CSV", () => save(name + ".csv", "text/csv", csv(m)));
    const back = button("⤺", "all", () => zoom(null));
    back.hidden = true;

    const [L, T, R, B] = m.box, full = { x: { ...m.x }, y: { ...m.y } };
    const part = (a, v) => (f(a, v) - f(a, a.lo)) / (f(a, a.hi) - f(a, a.lo));
    const X = v => L + part(m.x, v) * (R - L), Y = v => B - part(m.y, v) * (B - T);
    const value = (a, t) => inverse(a, f(a, a.lo) + t * (f(a, a.hi) - f(a, a.lo)));
    const seen = ({ p }) => { const x = X(p[0]), y = Y(p[1]); return x >= L - 1 && x <= R + 1 && y >= T - 1 && y <= B + 1; };
    const called = (a, v) => a.t?.find(([at]) => Math.abs(at - v) < 1e-6)?.[1] ?? number(v);
    const cross = el("g", { class: "cross" }, svg);
    let at = null;
    function show(q) {
      cross.replaceChildren();
      tip.hidden = !q;
      if (!(at = q)) return;
      const x = X(q.p[0]), y = Y(q.p[1]);
      el("path", { d: `M${x} ${T}V${B}M${L} ${y}H${R}`, class: "cross" }, cross);
      el("circle", { cx: x, cy: y, r: 4, class: "f " + q.s.c }, cross);
      const to = q.p.length > 2 ? `${called(m.y, q.p[1])}: ${number(q.p[2])}` : called(m.y, q.p[1]);
      tip.textContent = `${q.s.n && q.s.n + ": "}${called(m.x, q.p[0])} → ${to}${q.e ? " ± " + number(q.e) : ""}`;
      const k = svg.clientWidth / svg.viewBox.baseVal.width, w = tip.offsetWidth;
      tip.style.left = Math.max(0, Math.min(figure.clientWidth - w, x * k - w / 2)) + "px";
      tip.style.top = (y * k < 34 ? y * k + 14 : y * k - 34) + "px";
    }

    const home = { grid: svg.querySelector(".grid"), data: svg.querySelector(".data"), labels: [...svg.querySelectorAll("text.tl")] };
    const first = { grid: home.grid.innerHTML, data: home.data.innerHTML };
    function zoom(r) {
      show(null);
      back.hidden = !r;
      svg.querySelectorAll(".zt").forEach(e => e.remove());
      home.labels.forEach(t => t.style.display = r ? "none" : "");
      home.data.innerHTML = first.data;
      home.grid.innerHTML = first.grid;
      m.x = { ...full.x };
      m.y = { ...full.y };
      if (!r) return;
      // On linear and logarithmic axes alike a zoom is an affine map of the pixels.
      const kx = (R - L) / (X(r.x[1]) - X(r.x[0])), ky = (B - T) / (Y(r.y[0]) - Y(r.y[1])), tx = L - X(r.x[0]) * kx, ty = T - Y(r.y[1]) * ky;
      for (const p of home.data.querySelectorAll("path:not(.mk),rect,image")) {
        p.setAttribute("transform", `matrix(${kx} 0 0 ${ky} ${tx} ${ty})`);
        p.style.vectorEffect = "non-scaling-stroke";
      }
      for (const p of home.data.querySelectorAll("circle"))
        set(p, { cx: tx + kx * p.getAttribute("cx"), cy: ty + ky * p.getAttribute("cy") });
      for (const p of home.data.querySelectorAll("path.mk")) {
        const [cx, cy] = p.getAttribute("d").match(/[\d.-]+/g).map(Number);
        p.setAttribute("transform", `translate(${tx + kx * cx - cx} ${ty + ky * cy - cy})`);
      }
      home.data.querySelectorAll("text").forEach(t => t.remove());
      [m.x.lo, m.x.hi] = r.x;
      [m.y.lo, m.y.hi] = r.y;
      home.grid.replaceChildren();
      const label = (x, y, anchor, text) => el("text", { class: "tl zt", x, y, "text-anchor": anchor }, svg).textContent = text;
      for (const [v, t] of ticks(m.x, 5)) { el("path", { class: "g", d: `M${X(v)} ${T}V${B}` }, home.grid); label(X(v), B + 17, "middle", t); }
      for (const [v, t] of ticks(m.y, 4)) { el("path", { class: "g", d: `M${L} ${Y(v)}H${R}` }, home.grid); label(L - 8, Y(v) + 4, "end", t); }
    }

    const place = e => {
      const r = svg.getBoundingClientRect(), k = svg.viewBox.baseVal.width / r.width;
      return [(e.clientX - r.left) * k, (e.clientY - r.top) * k];
    };
    const on = (event, act) => svg.addEventListener(event, act);
    let start = null, rect = null, to = null;
    on("pointermove", e => {
      const [x, y] = place(e);
      if (start) {
        rect ??= el("rect", { class: "zoom" }, svg);
        to = [Math.max(L, Math.min(x, start[0])), Math.max(T, Math.min(y, start[1])), Math.min(R, Math.max(x, start[0])), Math.min(B, Math.max(y, start[1]))];
        const [a, b, c, d] = to;
        return set(rect, { x: a, y: b, width: Math.max(0, c - a), height: Math.max(0, d - b) });
      }
      let best = null, least = 900;
      for (const q of points) {
        const d = (X(q.p[0]) - x) ** 2 + (Y(q.p[1]) - y) ** 2;
        if (d < least && seen(q)) [least, best] = [d, q];
      }
      show(best);
    });
    on("pointerleave", () => show(null));
    on("pointerdown", e => { if (e.pointerType === "mouse") { start = place(e); e.preventDefault(); } });
    addEventListener("pointerup", () => {
      if (rect) {
        const [a, b, c, d] = to;
        rect.remove();
        if (c - a > 6 && d - b > 6)
          zoom({ x: [a, c].map(p => value(m.x, (p - L) / (R - L))), y: [d, b].map(p => value(m.y, (B - p) / (B - T))) });
      }
      rect = start = null;
    });
    on("dblclick", () => zoom(null));
    svg.tabIndex = 0;
    on("keydown", e => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[e.key], all = points.filter(seen);
      if (step && all.length) {
        show(all[(all.indexOf(at) + step + all.length) % all.length]);
        e.preventDefault();
      }
      if (e.key === "Escape") { show(null); zoom(null); }
    });
  }
})();
