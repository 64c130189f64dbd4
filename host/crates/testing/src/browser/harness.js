// Looks at each page in frames of some sizes and says what is wrong: POST /done.
(async () => {
  const wrong = [], frame = document.createElement("iframe");
  frame.style = "border:0";
  document.body.append(frame);
  const desk = [1280, 900], phone = [390, 844];
  const modes = [["light", desk], ["dark", desk], ["phone", phone], ["light, wide letters", desk], ["phone, wide letters", phone]];
  const open = (at, [width, height], sandbox) => new Promise(done => {
    sandbox ? frame.setAttribute("sandbox", sandbox) : frame.removeAttribute("sandbox");
    Object.assign(frame, { width, height, onload: () => setTimeout(done, 50), src: `/${at}` });
  });
  for (const [at, name] of NAMES.entries())
    try {
      for (const [mode, size] of modes) {
        await open(at, size);
        const w = frame.contentWindow;
        if (mode.endsWith("wide letters")) {
          const style = w.document.createElement("style");
          style.textContent = '* { font-family: "DejaVu Sans", Verdana, sans-serif !important }';
          w.document.head.append(style);
        }
        if (mode === "dark") w.document.documentElement.style.colorScheme = "dark";
        wrong.push(...[...w.errors, ...CHECKS(w)].map(what => `${name}, ${mode}: ${what}`));
      }
      await open(at, desk, "allow-same-origin");
      for (const f of frame.contentDocument.querySelectorAll("figure.plot"))
        if (!f.querySelector("svg path")) wrong.push(`${name}: nothing drawn without script`);
    } catch (e) {
      wrong.push(`${name}: ${e}`);
    }
  await fetch("/done", { method: "POST", body: wrong.join("\n") });
})();
