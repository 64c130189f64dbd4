// The link to camrig: one WebSocket, over which the page asks for what is next when it has shown what it had.

const link = { socket: null, seen: 0, frozen: false };
/** Pause before a link that broke is opened again, and between two looks of a page that nobody sees, ms. */
const REOPEN_PAUSE = 1000, HIDDEN_PAUSE = 1000;

const send = message => {
  if (link.socket && link.socket.readyState === WebSocket.OPEN) link.socket.send(JSON.stringify(message));
};

const askNext = () => send({ next: { seen: link.seen, event: events.newest, pixels: !link.frozen } });

/** The text and the samples of a message. */
function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  return [JSON.parse(text), new Uint16Array(buffer, 4 + length)];
}

/**
 * Opens the link, and opens it again when it breaks. `hear` is told every message; `draw` follows when the screen is
 * ready, and the next is asked for then: a page that draws slowly sees fewer frames.
 */
function openLink(hear, draw, lost) {
  // The token is in the address's fragment, which the browser keeps to itself.
  const token = location.hash.slice(1);
  const socket = new WebSocket(`ws://${location.host}/socket`, ["camrig", token].filter(Boolean));
  socket.binaryType = "arraybuffer";
  socket.addEventListener("open", () => {
    Object.assign(link, { socket, seen: 0 });
    events.newest = 0;
    askNext();
  });
  socket.addEventListener("message", ({ data }) => {
    const [state, samples] = unpack(data);
    link.seen = state.frames;
    hear(state, samples);
    if (document.hidden) setTimeout(askNext, HIDDEN_PAUSE);
    else requestAnimationFrame(() => { askNext(); draw(); });
  });
  socket.addEventListener("close", () => {
    lost(!link.socket);
    link.socket = null;
    setTimeout(() => openLink(hear, draw, lost), REOPEN_PAUSE);
  });
}
