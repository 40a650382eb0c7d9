// The few things that may be asked for. Each answer is the mission's own, or says that there is none.

const WAIT_MS = 4000;
const SHOWN_MS = 8000;
const NAMES = { start: 'START', 'fly-gaps': 'START INTO THE GAPS', hold: 'HOLD', resume: 'RESUME', return: 'RETURN', land: 'LAND HERE' };
const NAME_KEY = 'stockpilot.name';
const $ = (id) => document.getElementById(id);

let token = null;
let newest = null;
let wasDue = false;
let wasIdle = true;
// What the preflight list leads to: a survey from the beginning, or a flight into the gaps of the last one.
let startVerb = 'start';

/** Sends a request with the token; gives its status and answer, or a status of 0 without one. */
async function ask(path, body) {
  const stop = new AbortController();
  const timer = setTimeout(() => stop.abort(), WAIT_MS);
  try {
    const response = await fetch(path, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json', 'X-Stockpilot-Token': token ?? '' },
      body: JSON.stringify(body ?? {}),
      signal: stop.signal,
    });
    const text = await response.text();
    let answer = {};
    try { answer = text ? JSON.parse(text) : {}; } catch { answer = { reason: text }; }
    return { status: response.status, answer };
  } catch {
    return { status: 0, answer: { reason: 'no answer: use the mode switch' } };
  } finally {
    clearTimeout(timer);
  }
}

function tell(where, level, text) {
  where.dataset.level = level;
  where.textContent = text;
}

async function wish(verb, button, where, declared) {
  const name = NAMES[verb];
  button.dataset.state = 'asking';
  tell(where, 'unknown', `${name}: asking …`);
  const { status, answer } = await ask(`/api/wishes/${verb}`, { seq: newest?.seq, declared });
  const isAccepted = status === 200 && answer.is_accepted;
  button.dataset.state = isAccepted ? 'yes' : 'no';
  if (isAccepted) tell(where, 'good', `✓ ${name} acknowledged: ${answer.phase}`);
  else tell(where, 'bad', `✗ ${name} not acknowledged: ${answer.reason ?? `error ${status}`}`);
  if (status === 401 || status === 403) lock(answer.reason);
  setTimeout(() => { if (button.dataset.state !== 'asking') delete button.dataset.state; }, SHOWN_MS);
  return isAccepted;
}

function lock(reason) {
  token = null;
  show(newest);
  if (reason) tell($('answer'), 'bad', `✗ locked: ${reason}`);
}

const boxes = () => [...$('signed').querySelectorAll('input[type=checkbox]')];
const signer = () => $('declared-by').value.trim();
const isSigned = () => boxes().every((box) => box.checked) && signer() !== '';
/** What goes into the log with a start: who said what. */
const declaration = () => ({ by: signer(), ...Object.fromEntries(boxes().map((box) => [box.name, box.checked])) });

/** Follows a new state. */
export function show(state) {
  newest = state;
  const isOpen = token !== null && state !== null;
  for (const button of document.querySelectorAll('.buttons .act')) button.disabled = !isOpen;
  $('unlock').textContent = isOpen ? 'Lock controls' : 'Unlock controls';
  $('unlock').disabled = state !== null && !state.has_token;
  if (state === null) return;
  if (!state.has_token) tell($('answer'), 'unknown', 'Only looking: this vehicle has no token for the page.');
  $('resume').hidden = !(isOpen && state.phase === 'hold');
  showChecks(state, isOpen);
  showReview(state, isOpen);
}

function showChecks(state, isOpen) {
  const faults = state.preflight.filter((check) => check.fault).length;
  $('open-preflight').textContent =
    state.phase === 'idle' ? (faults ? `Preflight: ${faults} to mend` : 'Preflight: START …') : 'Preflight list';
  // Somebody has started it: nothing stands before the buttons of a vehicle that flies.
  if (wasIdle && state.phase !== 'idle') $('preflight-dialog').close();
  wasIdle = state.phase === 'idle';
  if (!$('preflight-dialog').open) return;
  showList(state.preflight);
  showStart(state);
  $('start').disabled = !(isOpen && faults === 0 && isSigned() && state.phase === 'idle');
  if (!isOpen) tell($('start-answer'), 'unknown', 'Unlock the controls to start.');
  else if (faults) tell($('start-answer'), 'degraded', 'Mend what is red first.');
  else if (!isSigned()) tell($('start-answer'), 'unknown', 'Say the four things above and who you are, then press START.');
  else if (!$('start').dataset.state) tell($('start-answer'), 'good', 'Ready.');
}

const inReach = (state) => state.review.gaps.filter((gap) => gap.is_in_reach);
const plural = (n, word) => `${n} ${word}${n === 1 ? '' : 's'}`;

/** What START would do, in words. */
function showStart(state) {
  const isIntoGaps = startVerb === 'fly-gaps';
  const n = inReach(state).length;
  const text = isIntoGaps
    ? `START flies into ${plural(n, 'gap')} and goes on with the map of the last flight.`
    : n ? 'START measures everything anew: the map of the last flight is let go. Its gaps are flown from “Decide on the flight”.'
      : '';
  $('start').textContent = isIntoGaps ? 'START INTO GAPS' : 'START';
  $('start-what').textContent = text;
  $('start-what').hidden = text === '';
}

function showList(checks) {
  const text = JSON.stringify(checks);
  if ($('checks').dataset.of === text) return;
  $('checks').dataset.of = text;
  $('checks').replaceChildren(...checks.map((check) => {
    const line = document.createElement('li');
    line.dataset.level = check.fault ? 'bad' : 'good';
    const part = (tag, text) => Object.assign(document.createElement(tag), { textContent: text });
    line.append(part('i', check.fault ? '■' : '●'), part('b', check.subject), part('span', check.found));
    if (check.fault) line.append(part('small', check.fault));
    return line;
  }));
}

function showReview(state, isOpen) {
  const { review } = state;
  $('open-review').hidden = !review.is_due;
  if (review.is_due && !wasDue && isOpen && !$('review-dialog').open) $('review-dialog').showModal();
  // Decided elsewhere, or the vehicle flies again: what stands here is of no flight any more.
  if (!review.is_due && wasDue) $('review-dialog').close();
  wasDue = review.is_due;
  for (const id of ['accept', 'reject']) $(id).disabled = !isOpen;
  const gaps = inReach(state);
  $('fly-gaps').hidden = gaps.length === 0;
  $('fly-gaps').disabled = !(isOpen && state.phase === 'idle');
  $('fly-gaps').textContent = gaps.length === 1 ? 'Fly the gap' : `Fly the ${gaps.length} gaps`;
  if (!$('review-dialog').open) return;
  const totals = state.volumes.map((v) => `${v.name}: ${v.stated_m3[0]} ± ${v.stated_m3[1]} m³ (k = 2)`);
  $('review-summary').textContent = totals.join('\n');
  const remarks = review.remarks.length ? review.remarks : ['nothing speaks against accepting it'];
  $('review-remarks').dataset.level = review.remarks.length ? 'degraded' : 'good';
  // The green button is what the numbers speak for.
  const isShort = review.remarks.length > 0;
  $('accept').className = isShort ? 'quiet' : 'primary';
  $('fly-gaps').className = isShort ? 'primary' : 'quiet';
  if ($('review-remarks').textContent !== remarks.join('')) {
    $('review-remarks').replaceChildren(...remarks.map((text) =>
      Object.assign(document.createElement('li'), { textContent: text })));
  }
  const left = review.gaps.map((gap, k) => {
    const [x, y] = gap.centre_m.map((place) => place.toFixed(1));
    const share = Math.round(100 * gap.share);
    return `${k + 1}. ${gap.bay ? `${gap.bay}, ` : ''}x ${x} m, y ${y} m: ${gap.area_m2.toFixed(1)} m², ${share < 1 ? 'under 1' : share} % of the variance${gap.is_in_reach ? '' : ' — out of reach'}`;
  });
  $('review-gaps').hidden = left.length === 0;
  if ($('review-gap-list').dataset.of !== left.join()) {
    $('review-gap-list').dataset.of = left.join();
    $('review-gap-list').replaceChildren(...left.map((text) =>
      Object.assign(document.createElement('li'), { textContent: text })));
  }
  if (!isOpen) tell($('review-answer'), 'unknown', 'Unlock the controls to decide.');
}

/** The name that was typed last in this browser. One that keeps nothing is asked every time. */
const keptName = () => { try { return localStorage.getItem(NAME_KEY) ?? ''; } catch { return ''; } };
function keepName(name) {
  try { localStorage.setItem(NAME_KEY, name); } catch { /* asked again next time */ }
}

async function decide(verdict) {
  const by = $('decided-by').value.trim();
  const { status, answer } = await ask('/api/review', { verdict, remark: $('remark').value, by: by || null });
  if (status === 200) {
    keepName(by);
    $('remark').value = '';
    $('review-dialog').close();
    tell($('answer'), 'good', `✓ flight ${verdict}, kept beside its log`);
  } else {
    tell($('review-answer'), 'bad', `✗ not kept: ${answer.reason ?? `error ${status}`}`);
  }
}

async function unlock(event) {
  if (event.submitter?.value !== 'ok') return;
  event.preventDefault();
  token = $('token').value.trim();
  const { status, answer } = await ask('/api/token');
  if (status === 204) {
    $('token').value = '';
    $('token-dialog').close();
    tell($('answer'), 'good', '✓ controls are open');
    show(newest);
  } else {
    token = null;
    tell($('token-answer'), 'bad', `✗ ${answer.reason ?? `error ${status}`}`);
  }
}

/** The list before the motors turn; everything on it is said anew each time. */
function openPreflight(verb) {
  startVerb = verb;
  delete $('start').dataset.state;
  for (const box of boxes()) box.checked = false;
  $('declared-by').value = '';
  $('preflight-dialog').showModal();
  show(newest);
}

/** Connects the buttons. */
export function connect() {
  for (const button of document.querySelectorAll('.buttons .act, #resume')) {
    button.addEventListener('click', () => wish(button.dataset.verb, button, $('answer')));
  }
  $('unlock').addEventListener('click', () => {
    if (token !== null) lock('by you');
    else $('token-dialog').showModal();
  });
  $('token-form').addEventListener('submit', unlock);
  $('open-preflight').addEventListener('click', () => openPreflight('start'));
  $('fly-gaps').addEventListener('click', () => {
    $('review-dialog').close();
    openPreflight('fly-gaps');
  });
  $('preflight-close').addEventListener('click', () => $('preflight-dialog').close());
  $('signed').addEventListener('input', () => show(newest));
  $('start').addEventListener('click', async () => {
    if (await wish(startVerb, $('start'), $('start-answer'), declaration())) {
      tell($('answer'), 'good', $('start-answer').textContent);
      $('preflight-dialog').close();
    }
  });
  $('decided-by').value = keptName();
  $('open-review').addEventListener('click', () => { $('review-dialog').showModal(); show(newest); });
  $('accept').addEventListener('click', () => decide('accepted'));
  $('reject').addEventListener('click', () => decide('rejected'));
}
