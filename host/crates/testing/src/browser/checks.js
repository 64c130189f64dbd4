// What must hold of a page of camrig in a window `w`; returns what does not, in words.
w => {
  const bad = [], d = w.document, all = q => [...d.querySelectorAll(q)], box = e => e.getBoundingClientRect();
  const named = e => e.closest("figure")?.dataset.name ?? "", shown = e => box(e).width > 0 && w.getComputedStyle(e).visibility !== "hidden";
  const luminance = c => {
    const [r, g, b] = c.match(/[\d.]+/g).map(Number).map(v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const contrast = (a, b) => { const [x, y] = [luminance(a), luminance(b)].sort((p, q) => q - p); return (x + 0.05) / (y + 0.05); };
  const ground = e => {
    for (; e; e = e.parentElement) {
      const c = w.getComputedStyle(e).backgroundColor;
      if (!/, 0\)$/.test(c)) return c;
    }
    return "rgb(255, 255, 255)";
  };

  // Width.
  if (d.documentElement.scrollWidth > w.innerWidth) {
    const wide = all("body *").filter(e => !e.closest(".scroll, pre, svg") && box(e).right > w.innerWidth + 1);
    bad.push(`wider than the window, ${d.documentElement.scrollWidth} px: ${wide.slice(0, 3).map(e => e.outerHTML.slice(0, 60))}`);
  }
  // With letters wider than those of the fonts that a page asks for, its tables may be scrolled.
  const canvas = d.createElement("canvas").getContext("2d");
  canvas.font = `100px ${w.getComputedStyle(d.body).fontFamily}`;
  const room = canvas.measureText("0").width > 57 ? 1.2 : 1;
  for (const t of all(".scroll")) if (t.scrollWidth > room * t.clientWidth + 1) bad.push(`a table is ${t.scrollWidth} px wide: ${t.innerText.slice(0, 40)}`);

  // Figures.
  for (const s of all("figure.plot > svg").filter(shown)) {
    const name = named(s), frame = box(s);
    const texts = [...s.querySelectorAll("text")].filter(t => t.textContent.trim()).map(t => [t.textContent, box(t), t]);
    texts.forEach(([a, x], i) => {
      for (const [b, y] of texts.slice(i + 1))
        if (x.left < y.right - 1 && y.left < x.right - 1 && x.top < y.bottom - 3 && y.top < x.bottom - 3) bad.push(`${name}: "${a}" lies on "${b}"`);
      if (x.left < frame.left - 2 || x.right > frame.right + 2 || x.top < frame.top - 2 || x.bottom > frame.bottom + 3) bad.push(`${name}: "${a}" leaves the figure`);
    });
    const clip = s.querySelector("clipPath rect"), [l, t, r, b] = ["x", "y", "width", "height"].map(k => clip[k].baseVal.value), points = [];
    for (const e of s.querySelectorAll(".data path.l:not(.ref,.need,.halo,.best), .data path.e, .data path.mk, .data circle")) {
      const m = e.getScreenCTM(), add = (x, y) => { if (x >= l && x <= l + r && y >= t && y <= t + b) points.push([m.a * x + m.e, m.d * y + m.f]); };
      if (e.tagName === "circle") { add(e.cx.baseVal.value, e.cy.baseVal.value); continue; }
      const length = e.getTotalLength(), step = Math.max(2, length / 2000);
      for (let k = 0; k <= length; k += step) { const p = e.getPointAtLength(k); add(p.x, p.y); }
    }
    for (const [text, r] of texts) {
      const n = points.filter(([x, y]) => x > r.left && x < r.right && y > r.top + 2 && y < r.bottom - 2).length;
      if (n) bad.push(`${name}: "${text}" over ${n} points of data`);
    }
    const scaled = frame.width / s.viewBox.baseVal.width;
    if (scaled < (w.matchMedia("print").matches ? 0.9 : 0.95)) bad.push(`${name}: scaled by ${scaled.toFixed(2)}`);
    for (const end of ["middle", "end"]) {
      const labels = [...s.querySelectorAll(`text.tl[text-anchor=${end}]`)].map(t => t.textContent);
      if (new Set(labels).size < labels.length) bad.push(`${name}: labels repeat: ${labels}`);
      if (labels.length < 1) bad.push(`${name}: an axis without labels`);
    }
    const axes = [...s.querySelectorAll("text.ax")].map(t => t.textContent.trim()), values = JSON.parse(s.closest("figure").querySelector("script").textContent);
    for (const [axis, text] of [values.y, values.x].map(a => [a, a.n]))
      if (!text || !axes.includes(text)) bad.push(`${name}: an axis without a name`);
      else if (!axis.t && !/,|%|\b(rows?|columns?|pixels?|photons|samples|SNR|ratio|modulation|MTF|rank|number|frames?|cycles|place|f-number|levels?|share|correlation|gain|deviate|times|factor|patch|statistic)\b/i.test(text)) bad.push(`${name}: an axis without a unit: ${text}`);
    if (s.getAttribute("role") !== "img" || !s.getAttribute("aria-label")) bad.push(`${name}: not described`);
    for (const e of s.querySelectorAll(".data path.l:not(.halo,.need), .data .f")) {
      const style = w.getComputedStyle(e), ink = style.stroke === "none" ? style.fill : style.stroke;
      if (!e.closest(".cells") && e.matches(".best") === false && contrast(ink, ground(s)) < 3) bad.push(`${name}: contrast of ${e.getAttribute("class")}, ${ink}`);
    }
  }

  // Text.
  for (const e of all("p,td,th,h1,h2,h3,dd,dt,figcaption,span,b,sub,summary,text,label,footer,code,pre").filter(e => e.textContent.trim() && shown(e))) {
    const style = w.getComputedStyle(e), svg = e.tagName === "text", words = e.textContent.trim().slice(0, 40);
    if (parseFloat(style.fontSize) < 11) bad.push(`small, ${style.fontSize}: "${words}"`);
    const under = e.classList.contains("cell") ? w.getComputedStyle(e.previousElementSibling).fill : ground(e);
    const k = contrast(svg ? style.fill : style.color, under);
    if (k < 4.5) bad.push(`contrast ${k.toFixed(1)}: "${words}"`);
    if (!e.closest("pre,code") && /\d[eE][-+]?\d/.test(e.textContent) && !e.querySelector("pre,code")) bad.push(`power of ten: "${words}"`);
    if (/\bNaN\b|undefined/.test(e.textContent)) bad.push(`no number: "${words}"`);
  }
  for (const i of d.images) {
    if (!i.alt) bad.push("a picture without words");
    if (!i.complete || !i.naturalWidth) bad.push(`a picture that is not decoded: ${i.alt}`);
  }
  for (const r of w.performance.getEntriesByType("resource")) if (!/^(data|blob):/.test(r.name)) bad.push(`a request: ${r.name}`);

  // The script: the values of the keys, zoom, and back.
  const figure = all("figure.plot").find(f => shown(f) && f.querySelector(".tools") && JSON.parse(f.querySelector("script").textContent).s.some(s => s.p.length > 1));
  if (all("figure.plot").length && !all(".tools").length) bad.push("the script does not run");
  if (figure) {
    const svg = figure.querySelector("svg"), tip = figure.querySelector(".tip"), { box: [L, T, R, B] } = JSON.parse(figure.querySelector("script").textContent);
    const key = k => svg.dispatchEvent(new w.KeyboardEvent("keydown", { key: k }));
    const pointer = (type, x, y) => svg.dispatchEvent(new w.PointerEvent(type, { clientX: box(svg).left + x, clientY: box(svg).top + y, pointerType: "mouse", bubbles: true }));
    key("ArrowRight");
    if (tip.hidden || !/\d.* → .|. → .*\d/.test(tip.textContent)) bad.push(`${named(svg)}: keys show no value`);
    // What is shown is a value of the data.
    const data = JSON.parse(figure.querySelector("script").textContent), raised = s => s.replace(/10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/, (_, d) => "e" + [...d].map(c => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)).map(i => i ? i - 1 : "-").join(""));
    const read = s => Number(raised(s).replace("−", "-").replace(/[\s\u202f·]/g, "")), near = (a, b) => Math.abs(a - b) <= 0.006 * Math.abs(b) + 1e-12;
    const [shown_x, shown_y] = tip.textContent.replace(/^.*: /, "").split(" → ").map(part => read(part.split(" ± ")[0]));
    if (!data.x.t && !data.y.t && !data.s.some(s => s.p.some(([x, y]) => near(shown_x, x) && near(shown_y, y)))) bad.push(`${named(svg)}: "${tip.textContent}" is no value of the data`);
    const labels = () => [...svg.querySelectorAll("text.tl")].filter(t => t.style.display !== "none").map(t => t.textContent).join("|"), before = labels();
    pointer("pointerdown", L + 0.3 * (R - L), T + 0.3 * (B - T));
    pointer("pointermove", L + 0.6 * (R - L), T + 0.6 * (B - T));
    pointer("pointerup", 0, 0);
    if (labels() === before) bad.push(`${named(svg)}: zoom changes no labels`);
    key("Escape");
    if (labels() !== before || !tip.hidden) bad.push(`${named(svg)}: Escape does not lead back`);
  }

  // Every point is in the CSV.
  let written = "";
  w.Blob = class { constructor(parts) { written = String(parts[0]); } };
  w.URL.createObjectURL = () => "";
  w.HTMLAnchorElement.prototype.click = () => 0;
  for (const f of all("figure.plot")) {
    const button = [...f.querySelectorAll(".tools button")].find(b => b.textContent === "CSV"), series = JSON.parse(f.querySelector("script").textContent).s;
    const points = series.reduce((n, s) => n + s.p.length, 0);
    if (!button) { if (points && all(".tools").length) bad.push(`${f.dataset.name}: no CSV`); continue; }
    try { button.click(); } catch (e) { bad.push(`${f.dataset.name}: CSV: ${e}`); }
    const lines = written.trim().split("\n").length;
    if (lines !== points + 1) bad.push(`${f.dataset.name}: ${lines - 1} of ${points} points in the CSV`);
  }
  return [...new Set(bad)];
}
