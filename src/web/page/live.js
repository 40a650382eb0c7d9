// The live state: a WebSocket that comes back by itself, and an honest word when it does not.

const RETRY_MS = 1000;
const OLD_MS = 1500;

/** Calls `onState` with every state and `onAge` with the age of the picture, ms, or null without one. */
export function follow(onState, onAge) {
  let heardAt = null;
  const open = () => {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = new WebSocket(`${scheme}://${location.host}/api/live`);
    socket.onmessage = (message) => {
      heardAt = performance.now();
      onState(JSON.parse(message.data));
    };
    socket.onclose = () => setTimeout(open, RETRY_MS);
    // A connection that went silent (out of reach) is given up, so that the next one is tried.
    const watch = setInterval(() => {
      if (socket.readyState > WebSocket.OPEN) clearInterval(watch);
      else if (heardAt !== null && performance.now() - heardAt > 4 * RETRY_MS) socket.close();
    }, RETRY_MS);
  };
  open();
  setInterval(() => onAge(heardAt === null ? null : performance.now() - heardAt), 250);
}

export const isOld = (age) => age === null || age > OLD_MS;

export async function fetchJson(path) {
  const response = await fetch(path, { cache: 'no-store' });
  if (!response.ok) return null;
  return response.json();
}
