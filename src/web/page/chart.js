// The volume and its U over time.

import uPlot from './vendor/uPlot.esm.js';

/** A band of V ± U with V in its middle. */
export class Chart {
  constructor(box) {
    this.box = box;
    this.plot = null;
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(box);
  }

  size() {
    return { width: Math.max(this.box.clientWidth, 200), height: 200 };
  }

  /** What the newest volume needs: the first seconds know nothing, and would press all later ones flat. */
  range(low, high) {
    const { volume_m3: volume, expanded_m3: expanded } = this.newest ?? { volume_m3: 0, expanded_m3: 1 };
    const reach = Math.max(3 * expanded, 0.4 * Math.abs(volume), 1);
    return [Math.max(low, volume - reach), Math.min(high, volume + reach)];
  }

  /** Shows points of {at_s, volume_m3, expanded_m3}. */
  show(points, startS) {
    this.newest = points.at(-1);
    const data = [
      points.map((p) => (p.at_s - startS) / 60),
      points.map((p) => p.volume_m3 + p.expanded_m3),
      points.map((p) => p.volume_m3 - p.expanded_m3),
      points.map((p) => p.volume_m3),
    ];
    if (this.plot) {
      this.plot.setData(data);
      return;
    }
    const axis = { stroke: '#b4c0cc', grid: { stroke: '#22303d', width: 1 }, ticks: { stroke: '#22303d' } };
    const digits = (u, value) => (value === null ? '–' : value.toFixed(1));
    this.plot = new uPlot({
      ...this.size(),
      scales: { x: { time: false }, y: { range: (u, low, high) => this.range(low, high) } },
      axes: [{ ...axis, label: 'minutes of flight', labelSize: 20, size: 34 }, { ...axis, size: 62 }],
      series: [
        { label: 'min', value: (u, value) => (value === null ? '–' : value.toFixed(1)) },
        { label: 'V + U', stroke: '#4a90b8', width: 1, value: digits, points: { show: false } },
        { label: 'V − U', stroke: '#4a90b8', width: 1, value: digits, points: { show: false } },
        { label: 'V', stroke: '#f2b134', width: 2.5, value: digits, points: { show: points.length < 2 } },
      ],
      bands: [{ series: [1, 2], fill: 'rgb(108 195 245 / 25%)' }],
      cursor: { drag: { x: false, y: false } },
      legend: { show: false },
    }, data, this.box);
  }
}
