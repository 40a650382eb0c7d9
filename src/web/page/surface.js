// The surface in three dimensions, with path, no-fly volumes, markers and the vehicle.

import * as THREE from 'three';
import { OrbitControls } from './vendor/OrbitControls.js';
import { palette } from './colours.js';

const GROUND = 0x06090d;

/** A view of the hall; hall axes, z up. */
export class SurfaceView {
  constructor(box, hall) {
    this.box = box;
    this.hall = hall;
    this.map = null;
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    box.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(GROUND);
    this.camera = new THREE.PerspectiveCamera(42, 1, 0.1, 2000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 0.49 * Math.PI;
    this.controls.addEventListener('change', () => this.draw());
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x1c242c, 1.0));
    const sun = new THREE.DirectionalLight(0xffffff, 2.6);
    // Low enough that slopes are told apart.
    sun.position.set(-1.0, -0.35, 0.75);
    this.scene.add(sun);
    this.addHall();
    this.addVehicle();
    this.look();
    new ResizeObserver(() => this.resize()).observe(box);
    this.resize();
  }

  look() {
    const [x0, y0, x1, y1] = this.hall.region_m;
    const size = Math.max(x1 - x0, y1 - y0);
    const middle = new THREE.Vector3((x0 + x1) / 2, (y0 + y1) / 2, 1);
    this.controls.target.copy(middle);
    this.camera.position.set(middle.x - 0.85 * size, middle.y - 1.25 * size, 1.05 * size);
    this.controls.update();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  addHall() {
    const { region_m: [x0, y0, x1, y1], walls_m, fence_m, obstacles, bays, tags_m, exclusions } = this.hall;
    this.loop([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], 0.01, 0x7d8a97);
    for (const bay of bays) this.loop(bay.corners_m, 0.02, 0xf1f5f9);
    if (walls_m.length) this.loop(walls_m, 0.01, 0xc6d0da);
    if (fence_m.length) this.loop(fence_m, this.hall.flight_height_m, 0x6cc3f5);
    for (const { corners_m, heights_m } of obstacles) this.prism(corners_m, heights_m, 0xff8a5c, 0.45);
    for (const [a, b, c, d] of exclusions) this.prism([[a, b], [c, b], [c, d], [a, d]], [0, 0.05], 0x39424c, 0.9);
    const tag = new THREE.BoxGeometry(0.18, 0.18, 0.18);
    const paint = new THREE.MeshBasicMaterial({ color: 0xf2b134 });
    for (const place of tags_m) {
      const box = new THREE.Mesh(tag, paint);
      box.position.set(...place);
      this.scene.add(box);
    }
  }

  loop(corners, z, colour) {
    const points = [...corners, corners[0]].map(([x, y]) => new THREE.Vector3(x, y, z));
    const geometry = new THREE.BufferGeometry().setFromPoints(points);
    this.scene.add(new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour })));
  }

  prism(corners, [low, high], colour, opacity) {
    const shape = new THREE.Shape(corners.map(([x, y]) => new THREE.Vector2(x, y)));
    const geometry = new THREE.ExtrudeGeometry(shape, { depth: Math.max(high - low, 0.02), bevelEnabled: false });
    const material = new THREE.MeshLambertMaterial({ color: colour, transparent: true, opacity, depthWrite: false });
    const solid = new THREE.Mesh(geometry, material);
    solid.position.z = low;
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry), new THREE.LineBasicMaterial({ color: colour }));
    edges.position.z = low;
    this.scene.add(solid, edges);
  }

  addVehicle() {
    this.vehicle = new THREE.Mesh(new THREE.ConeGeometry(0.4, 1.1, 12), new THREE.MeshLambertMaterial({ color: 0xf2b134, emissive: 0x5a3d00 }));
    // The cone's point along x.
    this.vehicle.geometry.rotateZ(-Math.PI / 2);
    this.drop = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineDashedMaterial({ color: 0xf2b134, dashSize: 0.3, gapSize: 0.3 }));
    this.path = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0xf1f5f9 }));
    this.ahead = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0x6cc3f5 }));
    this.vehicle.visible = false;
    for (const it of [this.path, this.ahead, this.drop]) it.frustumCulled = false;
    this.scene.add(this.vehicle, this.drop, this.path, this.ahead);
  }

  /** Shows a height map (or none yet) with what moves. */
  show(map, { path, ahead, pose }) {
    if (map && map !== this.map) this.build(map);
    const points = (places) => places.map((place) => new THREE.Vector3(...place));
    const set = (lineOf, places) => {
      lineOf.geometry.dispose();
      lineOf.geometry = new THREE.BufferGeometry().setFromPoints(points(places));
    };
    set(this.path, path);
    set(this.ahead, pose ? [pose.place_m, ...ahead] : []);
    this.vehicle.visible = Boolean(pose);
    if (pose) {
      this.vehicle.position.set(...pose.place_m);
      this.vehicle.rotation.z = pose.yaw_rad;
      set(this.drop, [pose.place_m, [pose.place_m[0], pose.place_m[1], 0]]);
      this.drop.computeLineDistances();
    }
    this.draw();
  }

  build(map) {
    this.map = map;
    const { n_cols: cols, n_rows: rows, cell_m: cell, values } = map;
    const { colour } = palette(map, this.hall);
    const [places, colours, faces] = [[], [], []];
    values.forEach((z, index) => {
      const [col, row] = [index % cols, Math.floor(index / cols)];
      places.push(map.x_min_m + (col + 0.5) * cell, map.y_min_m + (row + 0.5) * cell, z ?? 0);
      const linear = new THREE.Color().setRGB(...colour(z ?? 0).map((c) => c / 255), THREE.SRGBColorSpace);
      colours.push(linear.r, linear.g, linear.b);
      if (col + 1 < cols && row + 1 < rows) {
        const [a, b, c, d] = [index, index + 1, index + cols, index + cols + 1];
        if ([a, b, c, d].every((k) => values[k] !== null)) faces.push(a, b, d, a, d, c);
      }
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.Float32BufferAttribute(places, 3));
    geometry.setAttribute('color', new THREE.Float32BufferAttribute(colours, 3));
    geometry.setIndex(faces);
    geometry.computeVertexNormals();
    const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
    if (this.mesh) {
      this.scene.remove(this.mesh);
      this.mesh.geometry.dispose();
    }
    this.mesh = new THREE.Mesh(geometry, material);
    this.scene.add(this.mesh);
  }

  draw() {
    this.renderer.render(this.scene, this.camera);
  }
}
