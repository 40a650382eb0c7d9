// Maps from above: cells, and over them bays, walls, no-fly volumes, path, waypoints and the vehicle.

import { COVERAGE, css, palette, shade } from './colours.js';

const MARGIN_PX = 34;
const INK = '#f1f5f9';

/** A map on a canvas. */
export class MapView {
  constructor(canvas, scene, onTap) {
    this.canvas = canvas;
    this.scene = scene;
    this.map = null;
    this.cells = null;
    new ResizeObserver(() => this.draw()).observe(canvas);
    canvas.addEventListener('click', (event) => {
      const box = canvas.getBoundingClientRect();
      onTap(this.hall(event.clientX - box.left, event.clientY - box.top));
    });
  }

  /** Shows a map (or none yet) with what moves over it. */
  show(map, moving) {
    if (map !== this.map) this.cells = map && paint(map, this.scene);
    this.map = map;
    this.moving = moving;
    this.draw();
  }

  /** What is in the picture: the region, the walls around it, and where the vehicle is. */
  bounds() {
    const { region_m: region, walls_m: walls, fence_m: fence } = this.scene;
    const places = [[region[0], region[1]], [region[2], region[3]], ...walls, ...fence];
    const at = (axis, pick) => pick(...places.map((place) => place[axis]));
    return [at(0, Math.min), at(1, Math.min), at(0, Math.max), at(1, Math.max)];
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const [x0, y0, x1, y1] = this.bounds();
    const scale = Math.min((width - 2 * MARGIN_PX) / (x1 - x0), (height - 2 * MARGIN_PX) / (y1 - y0));
    const left = (width - scale * (x1 - x0)) / 2;
    const top = (height - scale * (y1 - y0)) / 2;
    return { scale, px: (x, y) => [left + scale * (x - x0), height - top - scale * (y - y0)] };
  }

  hall(px, py) {
    const { scale, px: of } = this.fit();
    const [x0, y0] = of(0, 0);
    return [(px - x0) / scale, (y0 - py) / scale];
  }

  draw() {
    const { canvas, scene, map, moving } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !moving) return;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const to = canvas.getContext('2d');
    to.scale(ratio, ratio);
    const { scale, px } = this.fit();
    if (map) {
      const [x, y] = px(map.x_min_m, map.y_min_m + map.n_rows * map.cell_m);
      to.imageSmoothingEnabled = map.kind !== 'coverage';
      to.drawImage(this.cells, x, y, scale * map.n_cols * map.cell_m, scale * map.n_rows * map.cell_m);
      if (map.kind === 'coverage') hatch(to, map, scale, px);
    }
    outline(to, px, rectangle(scene.region_m), { colour: '#7d8a97' });
    for (const bay of scene.bays) {
      outline(to, px, bay.corners_m, { colour: INK, width: 1.5 });
      label(to, px(...middle(bay.corners_m)), bay.name);
    }
    for (const it of scene.exclusions) outline(to, px, rectangle(it), { colour: '#7d8a97', fill: 'rgb(11 15 20 / 75%)' });
    outline(to, px, scene.walls_m, { colour: '#c6d0da', width: 3 });
    outline(to, px, scene.fence_m, { colour: '#6cc3f5', dash: [8, 6] });
    for (const it of scene.obstacles) {
      outline(to, px, it.corners_m, { colour: '#ff8a5c', width: 2, fill: 'rgb(255 138 92 / 22%)' });
    }
    this.drawMarkers(to, px);
    this.drawFlight(to, px);
    scaleBar(to, scale, width, height);
  }

  drawMarkers(to, px) {
    to.fillStyle = '#f2b134';
    for (const [x, y] of this.scene.tags_m) {
      const [a, b] = px(x, y);
      to.fillRect(a - 3, b - 3, 6, 6);
    }
  }

  drawFlight(to, px) {
    const { path, ahead, pose, cut, gaps } = this.moving;
    polyline(to, px, path, '#06090d', 4.5);
    polyline(to, px, path, INK, 2);
    if (pose) polyline(to, px, [pose.place_m, ...ahead], '#6cc3f5', 2, [5, 5]);
    to.fillStyle = '#6cc3f5';
    for (const [x, y] of ahead) disc(to, px(x, y), 3);
    if (cut) {
      const [, y] = px(0, cut[1]);
      const [a] = px(this.scene.region_m[0], 0);
      const [b] = px(this.scene.region_m[2], 0);
      line(to, [[a, y], [b, y]], '#f1f5f9', 1.5, [2, 4]);
    }
    if (pose) vehicle(to, px(...pose.place_m), pose);
    gaps.forEach((gap, k) => numbered(to, px(...gap.centre_m), k + 1, gap.is_in_reach));
  }
}

/** The cells of a map, one pixel each. */
function paint(map, scene) {
  const picture = new OffscreenCanvas(map.n_cols, map.n_rows);
  const to = picture.getContext('2d');
  const pixels = to.createImageData(map.n_cols, map.n_rows);
  const { colour } = palette(map, scene);
  map.values.forEach((value, index) => {
    if (value === null) return;
    const [col, row] = [index % map.n_cols, Math.floor(index / map.n_cols)];
    const light = map.kind === 'height' ? shade(map, index) : 1;
    const at = 4 * ((map.n_rows - 1 - row) * map.n_cols + col);
    colour(value).forEach((part, k) => { pixels.data[at + k] = part * light; });
    pixels.data[at + 3] = 255;
  });
  to.putImageData(pixels, 0, 0);
  return picture;
}

/** What nobody saw is hatched, so that it is seen without colours. */
function hatch(to, map, scale, px) {
  to.save();
  to.beginPath();
  map.values.forEach((value, index) => {
    if (value === null || !COVERAGE[value].hatch) return;
    const [col, row] = [index % map.n_cols, Math.floor(index / map.n_cols)];
    const [x, y] = px(map.x_min_m + col * map.cell_m, map.y_min_m + (row + 1) * map.cell_m);
    to.rect(x, y, scale * map.cell_m + 0.5, scale * map.cell_m + 0.5);
  });
  to.clip();
  const { width, height } = to.canvas;
  for (let x = -height; x < width; x += 8) line(to, [[x, 0], [x + height, height]], '#2b3744', 3);
  to.restore();
}

function trace(to, points) {
  to.beginPath();
  points.forEach(([x, y], k) => (k ? to.lineTo(x, y) : to.moveTo(x, y)));
}

function line(to, points, colour, width, dash = []) {
  trace(to, points);
  Object.assign(to, { strokeStyle: colour, lineWidth: width, lineJoin: 'round' });
  to.setLineDash(dash);
  to.stroke();
  to.setLineDash([]);
}

function polyline(to, px, places, colour, width, dash) {
  if (places.length > 1) line(to, places.map(([x, y]) => px(x, y)), colour, width, dash);
}

function outline(to, px, corners, { colour, width = 1, dash = [], fill }) {
  if (corners.length < 3) return;
  const points = [...corners, corners[0]].map(([x, y]) => px(x, y));
  if (fill) {
    trace(to, points);
    to.fillStyle = fill;
    to.fill();
  }
  line(to, points, colour, width, dash);
}

function disc(to, [x, y], radius) {
  to.beginPath();
  to.arc(x, y, radius, 0, 2 * Math.PI);
  to.fill();
}

function label(to, [x, y], text) {
  Object.assign(to, { font: '600 15px system-ui, sans-serif', textAlign: 'center', lineWidth: 4, strokeStyle: '#06090d', fillStyle: INK });
  to.strokeText(text, x, y);
  to.fillText(text, x, y);
}

/** An arrow along the heading; hollow while the place cannot be flown on. */
function vehicle(to, [x, y], pose) {
  to.save();
  to.translate(x, y);
  to.rotate(-pose.yaw_rad);
  trace(to, [[15, 0], [-9, 9], [-4, 0], [-9, -9], [15, 0]]);
  Object.assign(to, { fillStyle: pose.is_trusted ? '#f2b134' : '#06090d', strokeStyle: pose.is_trusted ? '#06090d' : '#ff8a5c', lineWidth: 2.5 });
  to.fill();
  to.stroke();
  to.restore();
}

/** A gap's number at its middle; dashed where no flight could look into it. */
function numbered(to, [x, y], number, isInReach) {
  to.beginPath();
  to.arc(x, y, 13, 0, 2 * Math.PI);
  Object.assign(to, { fillStyle: '#06090d', strokeStyle: '#ff8a5c', lineWidth: 2.5 });
  to.fill();
  to.setLineDash(isInReach ? [] : [3, 3]);
  to.stroke();
  to.setLineDash([]);
  Object.assign(to, { font: '700 14px system-ui, sans-serif', textAlign: 'center', textBaseline: 'middle', fillStyle: INK });
  to.fillText(String(number), x, y + 1);
  to.textBaseline = 'alphabetic';
}

function scaleBar(to, scale, width, height) {
  const metres = [0.5, 1, 2, 5, 10, 20, 50].find((m) => m * scale > 60) ?? 100;
  const [x, y] = [width - 16 - metres * scale, height - 14];
  line(to, [[x, y - 5], [x, y], [x + metres * scale, y], [x + metres * scale, y - 5]], '#b4c0cc', 2);
  Object.assign(to, { font: '13px system-ui, sans-serif', textAlign: 'right', fillStyle: '#b4c0cc' });
  to.fillText(`${metres} m`, x - 6, y + 1);
}

const rectangle = ([x0, y0, x1, y1]) => [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
const middle = (corners) => [0, 1].map((axis) => corners.reduce((sum, c) => sum + c[axis], 0) / corners.length);

/** The scale of a map in words and colours. */
export function legend(to, map, scene) {
  to.replaceChildren();
  const key = (text, colour) => {
    const item = Object.assign(document.createElement('span'), { className: 'key' });
    if (colour) {
      const swatch = Object.assign(document.createElement('span'), { className: 'swatch' });
      swatch.style.background = colour;
      item.append(swatch);
    }
    item.append(text);
    to.append(item);
  };
  if (!map) return;
  if (map.kind === 'coverage') {
    const counts = COVERAGE.map((_, state) => map.values.filter((value) => value === state).length);
    const all = counts.reduce((sum, n) => sum + n, 0) || 1;
    COVERAGE.forEach(({ name, colour }, k) => key(`${name} ${Math.round((100 * counts[k]) / all)} % of the area`, colour));
    return;
  }
  const { range: [low, high], colour } = palette(map, scene);
  const bar = Object.assign(document.createElement('canvas'), { width: 180, height: 1 });
  const paper = bar.getContext('2d');
  for (let k = 0; k < 180; k += 1) {
    paper.fillStyle = css(colour(low + (k / 179) * (high - low)));
    paper.fillRect(k, 0, 1, 1);
  }
  if (map.against) key(`since: ${map.against}`);
  const [digits, factor, unit] = { height: [1, 1, 'm'], sigma: [0, 100, 'cm (1 σ)'], 'fix-quality': [0, 1, ''], change: [0, 100, 'cm'] }[map.kind];
  key((factor * low).toFixed(digits).replace(/^-(0\.?0*)$/, '$1'));
  to.append(bar);
  key(`${(factor * high).toFixed(digits)} ${unit}`);
  if (map.kind === 'fix-quality') key(`waypoints need more than ${scene.min_fix_quality}; dark: none, black: too near to something`);
  key('marker', '#f2b134');
}

/** Heights along x through a place, with twice their σ, on a small canvas. */
export function section(canvas, height, sigma, y) {
  const row = Math.floor((y - height.y_min_m) / height.cell_m);
  if (row < 0 || row >= height.n_rows) return false;
  const of = (map) => map.values.slice(row * map.n_cols, (row + 1) * map.n_cols);
  const [h, s] = [of(height), sigma ? of(sigma) : []];
  const ratio = window.devicePixelRatio || 1;
  const [width, tall] = [canvas.clientWidth, canvas.clientHeight];
  Object.assign(canvas, { width: width * ratio, height: tall * ratio });
  const to = canvas.getContext('2d');
  to.scale(ratio, ratio);
  const top = Math.max(0.5, ...height.values.filter((v) => v !== null)) * 1.1;
  const px = (col, z) => [38 + ((col + 0.5) / height.n_cols) * (width - 50), tall - 16 - (Math.max(z, 0) / top) * (tall - 28)];
  const spread = (sign) => h.map((z, col) => px(col, z + sign * 2 * (s[col] ?? 0)));
  trace(to, [...spread(1), ...spread(-1).reverse()]);
  to.fillStyle = 'rgb(108 195 245 / 30%)';
  to.fill();
  line(to, h.map((z, col) => px(col, z)), '#f2b134', 2);
  Object.assign(to, { font: '12px system-ui, sans-serif', fillStyle: '#b4c0cc', textAlign: 'right' });
  for (const z of [0, top / 2, top]) {
    const [, at] = px(0, z);
    line(to, [[38, at], [width - 12, at]], '#2b3744', 1);
    to.fillText(z.toFixed(1), 32, at + 4);
  }
  return true;
}
