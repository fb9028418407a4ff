'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const element = (name, attributes, ...children) => {
    const made = Object.assign(document.createElement(name), attributes);
    made.append(...children);
    return made;
  };
  const hex = ([r, g, b]) => `rgb(${r}, ${g}, ${b})`;
  const view = document.getElementById('view');
  const reading = document.getElementById('reading');
  const layers = data.layers.map(layer => ({ ...layer, values: floats(layer.values), hidden: new Set(layer.hidden) }));
  const positions = floats(data.positions);
  const triangles = positions.length / 9;

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true });
  } catch (error) {
    reading.textContent = 'This browser shows nothing in 3D (WebGL is missing): see surface.png beside this file.';
    document.body.dataset.ready = 'without 3D';
    return;
  }
  view.append(renderer.domElement);
  renderer.setPixelRatio(window.devicePixelRatio);

  // Positions are relative to the middle of the part.
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf3f5f7);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 1.6));
  const lamp = new THREE.DirectionalLight(0xffffff, 1.8);
  const camera = new THREE.PerspectiveCamera(35, 1, data.radius / 200, data.radius * 60);
  camera.up.set(0, 0, 1);
  camera.add(lamp);
  lamp.position.set(0.4, 0.6, 1);
  scene.add(camera);
  const controls = new THREE.OrbitControls(camera, renderer.domElement);

  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  geometry.computeVertexNormals();
  const colours = new THREE.BufferAttribute(new Float32Array(positions.length), 3);
  geometry.setAttribute('color', colours);
  const surface = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide }));
  scene.add(surface);

  const groups = {};
  const group = (key, name, on, colour) => (groups[key] ??= { name, on, colour, group: new THREE.Group() }).group;
  data.arrows.forEach(({ direction }) => {
    // An arrow stands for a tool that comes from there.
    const towards = new THREE.Vector3(...direction);
    const from = towards.clone().multiplyScalar(1.9 * data.radius);
    group('arrows', 'directions', false).add(
      new THREE.ArrowHelper(towards.negate(), from, 0.6 * data.radius, 0x1f4e9c, 0.12 * data.radius, 0.07 * data.radius));
  });
  const mark = (at, colour, size) => {
    const made = new THREE.Mesh(new THREE.SphereGeometry(size * data.radius, 16, 12), new THREE.MeshBasicMaterial({ color: colour }));
    made.position.set(...at);
    return made;
  };
  data.places.forEach(({ at }) => group('places', data.place_name, true).add(mark(at, 0xc02020, 0.014)));
  data.paths.forEach(({ points, colour, name }) => {
    const line = new THREE.BufferGeometry();
    line.setAttribute('position', new THREE.BufferAttribute(floats(points), 3));
    group('path ' + name, name, true, hex(colour)).add(
      new THREE.LineSegments(line, new THREE.LineBasicMaterial({ color: new THREE.Color(hex(colour)) })));
  });
  Object.values(groups).forEach(entry => { entry.group.visible = entry.on; scene.add(entry.group); });

  const draw = () => renderer.render(scene, camera);
  const colour_of = (layer, value) => {
    if (layer.classes) return layer.classes[value]?.colour ?? [120, 120, 120];
    if (!Number.isFinite(value)) return layer.none.colour;
    const span = layer.high > layer.low ? (value - layer.low) / (layer.high - layer.low) : 0;
    const at = Math.round(Math.min(Math.max(span, 0), 1) * (layer.ramp.length - 1));
    return layer.ramp[at];
  };

  let current = 0;
  const paint = () => {
    const layer = layers[current];
    const colour = new THREE.Color();
    for (let triangle = 0; triangle < triangles; triangle++) {
      const value = layer.values[triangle];
      const [r, g, b] = layer.hidden.has(value) ? [226, 230, 234] : colour_of(layer, value);
      colour.setRGB(r / 255, g / 255, b / 255, 'srgb');
      for (let corner = 0; corner < 3; corner++) colours.setXYZ(3 * triangle + corner, colour.r, colour.g, colour.b);
    }
    colours.needsUpdate = true;
    // What is hidden of several bodies is not there; of one surface it is pale.
    const kept = [];
    for (let triangle = 0; layer.bodies && triangle < triangles; triangle++) {
      if (!layer.hidden.has(layer.values[triangle])) kept.push(3 * triangle, 3 * triangle + 1, 3 * triangle + 2);
    }
    geometry.setIndex(layer.bodies ? kept : null);
    document.querySelectorAll('#colours button').forEach((button, at) => button.setAttribute('aria-pressed', at === current));
    const legend = document.getElementById('legend');
    legend.replaceChildren();
    if (layer.classes) {
      layer.classes.forEach(({ name, colour }, value) => {
        if (!layer.values.includes(value)) return;
        const box = element('input', { type: 'checkbox', checked: !layer.hidden.has(value) });
        box.addEventListener('change', () => {
          if (box.checked) layer.hidden.delete(value); else layer.hidden.add(value);
          paint();
        });
        const swatch = element('span', { className: 'swatch' });
        swatch.style.background = hex(colour);
        legend.append(element('div', {}, element('label', {}, box, ' ', swatch, name)));
      });
    } else {
      const bar = element('div', { className: 'bar' });
      bar.style.background = `linear-gradient(90deg, ${layer.ramp.map(hex).join(', ')})`;
      const end = value => String(Number(value.toPrecision(4)));
      legend.append(layer.label, bar, element('div', { className: 'ends' },
        element('span', {}, end(layer.low)), element('span', {}, end(layer.high))));
      if (layer.values.some(value => !Number.isFinite(value))) {
        const swatch = element('span', { className: 'swatch' });
        swatch.style.background = hex(layer.none.colour);
        legend.append(element('div', {}, swatch, layer.none.name));
      }
    }
    draw();
  };
  layers.forEach((layer, at) => {
    const button = element('button', { type: 'button' }, layer.title);
    button.dataset.by = layer.name;
    button.addEventListener('click', () => { current = at; paint(); });
    document.getElementById('colours').append(button);
  });
  Object.values(groups).forEach(entry => {
    const box = element('input', { type: 'checkbox', checked: entry.on });
    box.addEventListener('change', () => { entry.group.visible = box.checked; draw(); });
    const swatch = element('span', { className: 'swatch' });
    swatch.style.background = entry.colour;
    document.getElementById('shown').append(element('label', {}, box, ' ', ...(entry.colour ? [swatch] : []), entry.name));
  });

  const tell = (layer, value) => {
    if (layer.classes) return layer.classes[value]?.name ?? '';
    return Number.isFinite(value) ? `${layer.label}: ${value.toPrecision(4)}` : layer.none.name;
  };
  const pointer = new THREE.Raycaster();
  let pressed = null;
  renderer.domElement.addEventListener('pointerdown', event => { pressed = [event.clientX, event.clientY]; });
  renderer.domElement.addEventListener('click', event => {
    // The end of a drag is no click.
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
    const box = renderer.domElement.getBoundingClientRect();
    pointer.setFromCamera(new THREE.Vector2(
      (event.clientX - box.left) / box.width * 2 - 1, 1 - (event.clientY - box.top) / box.height * 2), camera);
    const [hit] = pointer.intersectObject(surface);
    if (!hit) { reading.textContent = ''; return; }
    const at = hit.point.toArray().map((value, axis) => String(Number((value + data.middle[axis]).toPrecision(6))));
    const triangle = geometry.index ? geometry.index.getX(3 * hit.faceIndex) / 3 : hit.faceIndex;
    const lines = layers.map(layer => tell(layer, layer.values[triangle]));
    reading.textContent = [`(${at.join(', ')}) ${data.unit}`, ...lines].join('\n');
  });

  const look = (target, direction, distance) => {
    controls.target.copy(target);
    camera.position.copy(target).addScaledVector(direction.normalize(), distance);
    controls.update();
    draw();
  };
  // In a view that is narrower than it is high, from farther away.
  const whole = () => look(new THREE.Vector3(), new THREE.Vector3(1, -1.3, 0.9), 3.6 * data.radius / Math.min(1, camera.aspect));
  const again = element('button', { type: 'button' }, 'whole part');
  again.addEventListener('click', whole);
  document.getElementById('shown').append(again);
  document.querySelectorAll('tr[data-place]').forEach(row => row.addEventListener('click', () => {
    const { at, normal } = data.places[row.dataset.place];
    // Not straight along z, where up would have no meaning.
    look(new THREE.Vector3(...at), new THREE.Vector3(...normal).add(new THREE.Vector3(0.1, -0.15, 0.2)), 1.6 * data.radius);
  }));

  const resize = () => {
    const { clientWidth, clientHeight } = view;
    renderer.setSize(clientWidth, clientHeight, false);
    renderer.domElement.style.width = '100%';
    renderer.domElement.style.height = '100%';
    camera.aspect = clientWidth / Math.max(clientHeight, 1);
    camera.updateProjectionMatrix();
    draw();
  };
  window.addEventListener('resize', resize);
  controls.addEventListener('change', draw);
  paint();
  resize();
  whole();
  document.body.dataset.ready = 'yes';
})();
