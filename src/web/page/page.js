// The page: states in, everything that people see out. Text is only ever set as text.

import { Chart } from './chart.js';
import { connect, show as showControls } from './controls.js';
import { fetchJson, follow, isOld } from './live.js';
import { MapView, legend, section } from './map.js';

const $ = (id) => document.getElementById(id);
const SHAPES = { good: '●', degraded: '▲', bad: '■', unknown: '○' };
const MAP_OF_TAB = { surface: 'height' };

const scene = await fetchJson('/api/scene');
const chart = new Chart($('chart'));
const view = new MapView($('map'), scene, cutAt);
const maps = {};
let series = { volume: [], path_m: [] };
let tab = 'height';
let surface = null;
let newest = null;
let cut = null;
let fetching = false;

const element = (tag, className, text) => {
  const it = document.createElement(tag);
  if (className) it.className = className;
  if (text !== undefined) it.textContent = text;
  return it;
};

/** 12345.6 as "12 345.6", with thin spaces. */
const grouped = (digits) => {
  const [whole, part] = digits.split('.');
  const groups = whole.replace(/\B(?=(\d{3})+(?!\d))/g, '\u2009');
  return part ? `${groups}.${part}` : groups;
};
const clock = (seconds) => {
  const all = Math.max(0, Math.round(seconds));
  return `${Math.floor(all / 60)}:${String(all % 60).padStart(2, '0')}`;
};
const about = (seconds) => (seconds < 90 ? `${Math.max(10, Math.round(seconds / 10) * 10)}\u00a0s` : `${Math.round(seconds / 60)}\u00a0min`);
const percent = (ratio, digits = 0) => `${(100 * ratio).toFixed(digits)}\u00a0%`;
const shown = {};
/** True if `value` differs from the last one under this name: what did not change is not drawn again. */
const isNew = (name, value) => {
  const text = JSON.stringify(value);
  if (shown[name] === text) return false;
  shown[name] = text;
  return true;
};
const or = (value, text) => (value === null || value === undefined ? '–' : text(value));

function showStrip(state) {
  $('phase').textContent = state.phase;
  $('phase').dataset.intoGaps = String(state.is_into_gaps && state.phase !== 'idle');
  $('phase-reason').textContent = state.phase_reason;
  $('flight-time').textContent = or(state.flight_s, clock);
  const [done, ahead] = state.steps;
  $('steps').textContent = ahead || done ? `${done} / ${done + ahead}` : '–';
  $('version').textContent = `stockpilot ${state.version}`;
  const { now, dropped } = state.viewers;
  $('viewers').textContent = `${now} looking${dropped ? `, ${dropped} dropped` : ''}`;
}

function showAlarms(warnings) {
  if (!isNew('alarms', warnings)) return;
  $('alarms').replaceChildren(...warnings.slice(0, 3).map(({ level, what, todo }) => {
    const it = element('div', 'alarm');
    it.dataset.level = level;
    it.append(element('i', '', SHAPES[level]), element('b', '', what), element('span', '', `→ ${todo}`));
    return it;
  }));
}

const ARROWS = { '-1': '↓', 0: '→', 1: '↑' };
// As reports call them.
const SOURCE_NAMES = { prior: 'gaps' };
const SHARE_NAMES = ['measured', 'interpolated', 'never seen', 'moved'];

function volumeCard(volume, target, { isFinal, isFlying, isAll, isAlone }) {
  const card = element('article', isAll ? 'volume all' : 'volume');
  card.append(element('h3', '', volume.name));
  const figure = element('p', 'figure');
  const unit = isAll || isAlone ? 'm³ (k = 2)' : 'm³';
  figure.append(grouped(volume.stated_m3[0]), ' ', element('span', 'pm', `± ${grouped(volume.stated_m3[1])}`), ' ', element('span', 'of', unit));
  card.append(figure);
  if (volume.stated_t) {
    card.append(element('p', 'tonnes', `${grouped(volume.stated_t[0])} ± ${grouped(volume.stated_t[1])} t`));
  }
  card.append(aim(volume, target, isFinal));
  if (isFlying && (isAll || isAlone) && target.left_s !== null) card.append(element('p', 'aim', wayAhead(target)));
  const bar = element('div', 'shares');
  volume.shares.forEach((share, k) => {
    const part = element('i', `s${k}`);
    part.style.width = `${(100 * share).toFixed(1)}%`;
    bar.append(part);
  });
  const words = volume.shares.map((share, k) => (share >= 0.005 ? `${SHARE_NAMES[k]} ${percent(share)}` : ''));
  card.append(bar, element('p', 'share-words', words.filter(Boolean).join(' · ')));
  const sources = volume.sources.filter(({ share }) => share >= 0.005).map(({ name, share }) => `${SOURCE_NAMES[name] ?? name.replaceAll('_', ' ')} ${percent(share)}`);
  if (sources.length) card.append(element('p', 'sources', `U comes from: ${sources.join(', ')}`));
  return card;
}

/** What the plan leads to; a planner that looks only a few waypoints ahead has none. */
function wayAhead({ left_s: left, end_percent: end }) {
  return `way ahead: about\u00a0${about(left)}${end === null ? '' : `, then U about\u00a0${fewDigits(end)}\u00a0%`}`;
}

function aim(volume, target, isFinal) {
  const line = element('p', 'aim');
  if (volume.expanded_percent === null) {
    line.textContent = 'too little for a percentage';
    return line;
  }
  const isMet = volume.expanded_percent <= target.percent;
  const now = element('b', isMet ? 'met' : 'unmet', `${volume.expanded_percent > 100 ? 'over\u00a0100' : fewDigits(volume.expanded_percent)}\u00a0%${isFinal ? '' : `\u00a0${ARROWS[volume.trend]}`}`);
  line.append('U\u00a0', now, ` ${isFinal ? 'reached' : 'now'}, target\u00a0${target.percent.toFixed(1)}\u00a0%${isMet ? '\u00a0✓' : ''}`);
  return line;
}

function showVolumes(state) {
  const box = $('volumes');
  const n = state.volumes.length;
  $('no-volume').hidden = n > 0;
  box.dataset.n = n > 2 ? 'many' : String(n);
  const isFlying = !['idle', 'preflight', 'land', 'abort'].includes(state.phase);
  // The whole stands first and over the whole width, its bays below.
  const cards = state.volumes.map((volume, k) => volumeCard(volume, state.target, {
    isFinal: state.is_final, isFlying, isAll: n > 2 && k === 0, isAlone: n === 1,
  }));
  box.replaceChildren($('no-volume'), ...cards);
}

/** Two digits or so: what lies beyond is noise. */
const fewDigits = (value) => value.toFixed(value >= 10 ? 0 : value >= 1 ? 1 : 2);
const cm = (metres) => `${(100 * metres).toFixed(1)} cm`;

function gauges(state) {
  const { fix, lidar, camera, battery, link, computer } = state;
  return [
    ['Position', fix.level, `${or(fix.sigma_xy_m, cm)} / ${or(fix.sigma_z_m, cm)}`,
      `1 σ level / height · ${fix.markers[1]} of ${fix.markers[0]} markers used · residual ${or(fix.residual_px, (px) => `${px.toFixed(2)} px`)} · last ${or(fix.age_s, (s) => `${s.toFixed(1)} s ago`)}`],
    ['LiDAR', lidar.level, lidar.health,
      `${lidar.turns_hz.toFixed(1)} turns/s · ${or(lidar.return_ratio, (r) => `${percent(r)} come back`)} · ${or(lidar.dust_ratio, (r) => `${percent(r, 1)} dust or moving`)}${lidar.lost_beams ? ` · ${lidar.lost_beams} lost` : ''}`],
    ['Camera', camera.level, `${camera.frames_hz.toFixed(0)} frames/s`,
      `${or(camera.latency_s, (s) => `${(1000 * s).toFixed(0)} ms late`)}${camera.refused ? ` · ${camera.refused} refused` : ''}`],
    ['Battery', battery.level, or(battery.percent, (p) => `${p.toFixed(0)} %`),
      `${or(battery.left_s, (s) => `about ${about(s)} until it turns home by itself`)} at ${battery.turns_home_at_percent.toFixed(0)} % · ${or(battery.voltage_v, (v) => `${v.toFixed(1)} V`)}`],
    ['Autopilot', link.level, `${link.mode}${link.is_armed ? ', armed' : ''}`,
      `${percent(link.missed_ratio, 1)} lost · its place is ${or(link.disagreement_m, cm)} off${link.refused_frames ? ` · ${link.refused_frames} frames refused` : ''}`],
    ['Computer', computer.level, computer.is_clock_known ? 'clocks agree' : 'autopilot’s clock unknown',
      `log ${computer.log} · ${or(computer.free_bytes, (b) => `${(b / 1e9).toFixed(1)} GB free`)} · lost: ${computer.records_lost} log entries, ${computer.ticks_skipped} ticks, ${computer.other_lost} else`],
  ];
}

function showHealth(lines) {
  $('health').replaceChildren(...lines.map(([name, level, value, detail]) => {
    const it = element('li', 'gauge');
    it.dataset.level = level;
    const shape = element('i', '', SHAPES[level]);
    shape.title = level;
    it.append(shape, element('b', '', name), element('span', '', value), element('small', '', detail));
    return it;
  }));
}

function showLines(lines) {
  $('lines').replaceChildren(...[...lines].reverse().map(({ at_s, level, text }) => {
    const it = element('li');
    it.dataset.level = level;
    it.append(element('time', '', clock(at_s)), element('span', '', text));
    return it;
  }));
}

const wantedMap = () => MAP_OF_TAB[tab] ?? tab;

/** Fetches what is newer than what is known; one round at a time. */
async function refresh(state) {
  if (fetching) return;
  fetching = true;
  try {
    const kinds = new Set([wantedMap(), ...(cut ? ['height', 'sigma'] : [])]);
    for (const kind of kinds) {
      const version = state.maps[kind.replace('-', '_')];
      if (version === 0) delete maps[kind];
      else if (maps[kind]?.version !== version) maps[kind] = (await fetchJson(`/api/maps/${kind}`)) ?? undefined;
    }
    if (series.volume.length !== state.n_points) {
      series = (await fetchJson('/api/series')) ?? series;
      const start = state.flight_s === null ? 0 : state.at_s - state.flight_s;
      chart.show(series.volume, start);
    }
  } finally {
    fetching = false;
  }
}

function grow(state) {
  if (state.phase === 'preflight' && !state.is_into_gaps) series.path_m = [];
  const flying = !['idle', 'preflight'].includes(state.phase);
  const last = series.path_m.at(-1);
  const place = state.pose?.place_m;
  if (flying && place && (!last || Math.hypot(...place.map((x, k) => x - last[k])) > 0.1)) series.path_m.push(place);
}

function showStage(state) {
  const map = maps[wantedMap()] ?? null;
  const moving = { path: series.path_m, ahead: state.ahead_m, pose: state.pose, cut, gaps: state.review.gaps };
  $('map').hidden = tab === 'surface';
  $('surface').hidden = tab !== 'surface';
  const { place_m: place, yaw_rad: yaw, is_trusted: trusted } = state.pose ?? {};
  const seen = [place?.map((x) => x.toFixed(2)), yaw?.toFixed(2), trusted, state.ahead_m.length, series.path_m.length, cut, state.review.gaps.length];
  if (isNew('stage', [tab, surface !== null, map?.version, seen])) {
    if (tab === 'surface') surface?.show(map, moving);
    else view.show(map, moving);
  }
  $('stage-note').textContent = map ? '' : 'not measured yet';
  if ($('legend').dataset.of !== `${tab} ${map?.version}`) {
    $('legend').dataset.of = `${tab} ${map?.version}`;
    legend($('legend'), map, scene);
  }
  document.querySelector('[data-map="change"]').hidden = state.maps.change === 0;
  showSection();
}

function showSection() {
  if (!isNew('section', [cut, maps.height?.version, maps.sigma?.version])) return;
  // A hidden canvas has no size to draw on.
  $('section').hidden = cut === null;
  if (cut === null || !maps.height) return;
  if (section($('section-canvas'), maps.height, maps.sigma, cut[1])) {
    $('section-caption').textContent = `Section along x at y = ${cut[1].toFixed(1)} m: height, m, and ± 2 σ. Tap it to close.`;
  }
}

function cutAt(place) {
  cut = place;
  if (newest) refresh(newest).then(() => showStage(newest));
}

async function choose(name) {
  tab = name;
  for (const button of $('tabs').children) button.setAttribute('aria-selected', String(button.dataset.map === name));
  if (name === 'surface' && !surface) {
    // Seven hundred kilobytes that only this view needs.
    const { SurfaceView } = await import('./surface.js');
    $('surface').hidden = false;
    surface = new SurfaceView($('surface'), scene);
  }
  if (!newest) return;
  // The old map must not stand under the new name while the new one is fetched.
  showStage(newest);
  await refresh(newest);
  showStage(newest);
}

function showState(state) {
  newest = state;
  showStrip(state);
  showAlarms(state.warnings);
  const { volumes, target, phase, is_final } = state;
  if (isNew('volumes', [volumes, { ...target, left_s: or(target.left_s, about) }, phase, is_final])) showVolumes(state);
  showControls(state);
  const lines = gauges(state);
  if (isNew('health', lines)) showHealth(lines);
  if (isNew('lines', state.lines)) showLines(state.lines);
  grow(state);
  refresh(state).then(() => showStage(state));
}

function showAge(age) {
  const it = $('liveness');
  if (!isOld(age)) {
    it.textContent = 'live';
    it.dataset.level = 'good';
    return;
  }
  it.textContent = age === null ? 'none' : `${Math.round(age / 1000)} s old`;
  it.dataset.level = 'bad';
  const what = age === null ? 'no connection to the vehicle' : `the picture is ${Math.round(age / 1000)} s old`;
  showAlarms([{ level: 'bad', what, todo: 'the vehicle flies on by itself; in doubt use the mode switch' }]);
  // Who starts something must see something.
  showControls(newest);
}

connect();
for (const button of $('tabs').children) button.addEventListener('click', () => choose(button.dataset.map));
$('section').addEventListener('click', () => { cut = null; showSection(); });
follow(showState, showAge);
