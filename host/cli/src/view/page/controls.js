// Sliders, choices and registers.

/** Least time between two orders of one slider, ms: what a rig's registers follow. */
const ORDER_PAUSE = 100;

const sliders = {
  lux: {
    order: "lux", to: v => 10 ** v, from: Math.log10,
    words: v => v === null ? (state.status === "starting" ? "–" : "the scene's light") : `${whole(+v.toPrecision(4))} lx`,
  },
  exposure: { order: "exposure_s", to: v => 10 ** v, from: Math.log10, words: seconds },
  gain: { order: "analog_gain", to: v => 2 ** v, from: Math.log2, words: v => `× ${v.toFixed(2)}` },
};

function setUpSlider(id, send) {
  const slider = sliders[id], input = at(id);
  let timer = null;
  input.addEventListener("input", () => {
    slider.held = performance.now();
    say(`${id}-now`, slider.words(slider.to(Number(input.value))));
    timer ||= setTimeout(() => {
      timer = null;
      send({ set: { [slider.order]: Number(slider.to(Number(input.value)).toPrecision(4)) } });
    }, ORDER_PAUSE);
  });
}

/**
 * Shows a value, unless a hand is on its slider: the slider stands where it was set, the words say what is in force.
 */
function showSlider(id, asked, inForce) {
  const slider = sliders[id];
  at(id).disabled = asked === null;
  if (performance.now() - (slider.held || -Infinity) < 1000) return;
  if (asked !== null) at(id).value = slider.from(asked);
  say(`${id}-now`, slider.words(inForce));
}

/** Fills a choice once, and shows what is chosen. */
function showChoice(id, names, chosen) {
  const select = at(id);
  if (select.children.length !== names.length) {
    select.replaceChildren(...names.map(name => element("option", { value: name }, name)));
  }
  select.disabled = chosen === null;
  if (document.activeElement !== select && chosen !== null) select.value = chosen;
}

function showControls(state, frame) {
  const { settings, source, busy } = state;
  showSlider("lux", settings.lux, settings.lux);
  showSlider("exposure", settings.exposure_s, frame ? frame.exposure_s : settings.exposure_s);
  showSlider("gain", settings.analog_gain, frame ? frame.analog_gain : settings.analog_gain);
  at("auto").checked = settings.auto_exposure;
  showChoice("illuminant", source.illuminants, settings.illuminant);
  showChoice("scene", source.scenes, settings.scene);
  // Before the first frame the status says it.
  at("busy").hidden = !busy || state.status === "starting";
  say("busy", busy ? `${busy} …` : "");
}

/** Shows the registers; a value that is being typed is left alone. */
function showRegisters(registers, send) {
  const body = document.querySelector("#registers tbody");
  if (body.children.length !== registers.length) {
    body.replaceChildren(...registers.map(({ address, name, writable }) => {
      const input = element("input", { "aria-label": name });
      input.disabled = !writable;
      input.addEventListener("change", () => writeRegister(address, input.value, send));
      const cells = [element("code", {}, hex(address)), name, input].map(content => element("td", {}, content));
      return element("tr", {}, ...cells);
    }));
  }
  registers.forEach(({ value }, i) => {
    const input = body.children[i].querySelector("input");
    if (document.activeElement !== input) input.value = value;
  });
}

function writeRegister(address, text, send) {
  const value = typed(text);
  if (address >= 0 && address <= 0xffff && value <= 0xffffffff) send({ set: { register: { address, value } } });
  else takeLocal("addresses and values must be numbers such as 514 or 0x0202");
}

/** Tells a mistake that the page finds itself. */
function takeLocal(text) {
  showBanner({ frame: state ? state.frames : 0, source: "page", text, count: 1 });
}

function setUpControls(send) {
  Object.keys(sliders).forEach(id => setUpSlider(id, send));
  at("auto").addEventListener("change", e => send({ set: { auto_exposure: e.target.checked } }));
  for (const id of ["illuminant", "scene"]) {
    at(id).addEventListener("change", e => { send({ set: { [id]: e.target.value } }); e.target.blur(); });
  }
  const read = () => { if (at("registers").open) send({ set: "registers" }); };
  at("registers").addEventListener("toggle", read);
  setInterval(read, 1000);
  at("other").addEventListener("submit", event => {
    event.preventDefault();
    writeRegister(typed(at("other-address").value), at("other-value").value, send);
  });
}
