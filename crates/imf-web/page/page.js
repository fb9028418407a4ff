'use strict';
(() => {
  const get = id => document.getElementById(id);
  const progress = get('progress'), reading = get('reading'), view = get('view');

  // The worker: the module inside it, asked by messages.
  const text = id => get(id).textContent.replaceAll('<\\/script', '</script');
  const script = URL.createObjectURL(new Blob([text('worker')], { type: 'text/javascript' }));
  const waiting = new Map();
  let count = 0, worker;
  const answered = ({ data: { id, error, broken, done: fraction, ...answer } }) => {
    const { done, failed } = waiting.get(id);
    if (fraction !== undefined) { get('errors').textContent = `the field: ${(100 * fraction).toFixed(0)} %`; return; }
    waiting.delete(id);
    // One that ends at its start would do so again.
    if (broken && ramp) {
      get('field').value = '';
      begin().catch(other => other === OTHER || tell(other.message, true));
    }
    if (error === undefined) done(answer); else failed(new Error(error));
  };
  const ask = (what, more, moved) => new Promise((done, failed) => {
    waiting.set(++count, { done, failed });
    worker.postMessage({ id: count, ask: what, ...more }, moved ?? []);
  });
  const forget_tool = () => {
    stage.remove(tool);
    tool = values = undefined;
    reading.textContent = '';
  };
  const forget_field = () => {
    compared = undefined;
    get('errors').textContent = '';
    get('fitted').parentElement.hidden = get('over').parentElement.hidden = true;
  };
  // A new worker, which has neither part nor field; what the old one was asked is not answered.
  const OTHER = new Error('something else was asked for');
  const begin = () => {
    worker?.terminate();
    for (const { failed } of waiting.values()) failed(OTHER);
    waiting.clear();
    forget_tool();
    forget_field();
    worker = new Worker(script);
    worker.onmessage = answered;
    return ask('start', { module: text('module') }).then(started => { ({ ramp } = started); });
  };
  const tell = (line, failed) => { progress.textContent = line; progress.className = failed ? 'failed' : ''; };
  const guarded = work => async event => {
    event?.preventDefault?.();
    try { await work(event); } catch (error) { if (error !== OTHER) tell(error.message, true); }
  };
  // Asked again while it works, it works once more when it has ended.
  const once_more = work => {
    let works = false, again = false;
    return async () => {
      again = true;
      if (works) return;
      works = true;
      try { while (again) { again = false; await work(); } } finally { works = false; }
    };
  };

  // What is seen.
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true });
  } catch (error) {
    reading.textContent = 'This browser shows nothing in 3D (WebGL is missing); the figures below are computed all the same.';
  }
  const stage = new THREE.Scene();
  stage.background = new THREE.Color(0xf3f5f7);
  stage.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 1.6));
  const camera = new THREE.PerspectiveCamera(35, 1, 0.1, 10000);
  const lamp = new THREE.DirectionalLight(0xffffff, 1.8);
  lamp.position.set(0.4, 0.6, 1);
  camera.up.set(0, 0, 1);
  camera.add(lamp);
  stage.add(camera);
  let controls;
  const draw = () => renderer?.render(stage, camera);
  if (renderer) {
    view.append(renderer.domElement);
    renderer.setPixelRatio(window.devicePixelRatio);
    controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.listenToKeyEvents?.(view);
    controls.addEventListener('change', draw);
    const resize = () => {
      renderer.setSize(view.clientWidth, view.clientHeight, false);
      Object.assign(renderer.domElement.style, { width: '100%', height: '100%' });
      camera.aspect = view.clientWidth / Math.max(view.clientHeight, 1);
      camera.updateProjectionMatrix();
      draw();
    };
    window.addEventListener('resize', resize);
    resize();
  }
  const mesh_of = (corners, material) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(corners, 3));
    geometry.computeVertexNormals();
    return new THREE.Mesh(geometry, material);
  };
  const VERDICTS = [
    ['reached', [120, 190, 110]], ['something is in the way', [235, 140, 40]],
    ['the cutter does not fit', [170, 40, 130]], ['no direction faces it', [90, 90, 95]],
  ];
  let surface, tool, unit = 'mm', dims = [1, 1, 1], values, ramp, compared;

  const show_part = (corners, colour_of) => {
    if (surface) stage.remove(surface);
    const colours = new Float32Array(corners.length);
    const colour = new THREE.Color();
    for (let triangle = 0; triangle < corners.length / 9; triangle++) {
      const [r, g, b] = colour_of(triangle);
      colour.setRGB(r / 255, g / 255, b / 255, 'srgb');
      for (let corner = 0; corner < 3; corner++) colours.set([colour.r, colour.g, colour.b], 9 * triangle + 3 * corner);
    }
    surface = mesh_of(corners, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide }));
    surface.geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
    stage.add(surface);
  };
  const look_at_all = () => {
    const box = new THREE.Box3().setFromObject(surface);
    const middle = box.getCenter(new THREE.Vector3()), radius = 0.5 * box.getSize(new THREE.Vector3()).length();
    camera.near = radius / 200;
    camera.far = radius * 60;
    camera.position.copy(middle).addScaledVector(new THREE.Vector3(1, -1.3, 0.9).normalize(), 3.6 * radius);
    camera.updateProjectionMatrix();
    controls?.target.copy(middle);
    controls?.update();
  };

  // A part and a tool.
  let file = null;
  const take = given => { file = given; get('part').value = ''; tell(`${given.name}: choose its unit, then compute`); };
  get('file').addEventListener('change', event => event.target.files[0] && take(event.target.files[0]));
  document.addEventListener('dragover', event => event.preventDefault());
  document.addEventListener('drop', guarded(event => event.dataTransfer.files[0] && take(event.dataTransfer.files[0])));
  // Of several computations that were asked for, the last.
  let latest = 0;
  const compute = async () => {
    const mine = ++latest;
    const part = get('part').value;
    if (!part && !file) throw new Error('Choose a mesh file first, or a built-in part.');
    const bytes = part ? null : await file.arrayBuffer();
    if (mine !== latest) return;
    const pitch = Number(get('pitch').value) || undefined;
    get('legend').replaceChildren();
    forget_tool();
    // What is computed now would be waited for.
    if (waiting.size) await begin();
    if (mine !== latest) return;
    tell('voxels …');
    const made = await ask('scene', { part, file: bytes, name: file?.name, unit: get('unit').value, tool: get('tool').value, pitch });
    if (mine !== latest) return;
    ({ unit, dims } = made);
    // A field that was loaded may be of another part.
    forget_field();
    get('field').value = '';
    set_layers(dims[2]);
    show_part(made.corners, () => [160, 160, 165]);
    tool = mesh_of(made.tool, new THREE.MeshLambertMaterial({ color: 0x4c78a8, side: THREE.DoubleSide }));
    tool.visible = false;
    stage.add(tool);
    look_at_all();
    const begun = performance.now();
    const { triangles } = await ask('begin', { directions: get('directions').value, samples: 8000 });
    for (let left = triangles, found; left > 0; left = found.left) {
      if (mine !== latest) return;
      found = await ask('advance', { count: 512 });
      const seconds = 0.001 * (performance.now() - begun), done = triangles - found.left;
      tell(`${done} of ${triangles} places, ${(seconds * found.left / Math.max(done, 1)).toFixed(0)} s left`);
      if (found.left === 0) show_access(found, seconds, made);
    }
    if (mine === latest) await show_section();
  };
  const show_access = ({ corners, verdicts, areas, by }, seconds, { warnings, pitch }) => {
    show_part(corners, triangle => VERDICTS[verdicts[triangle]][1]);
    const whole = areas.reduce((sum, area) => sum + area, 0);
    const percent = area => `${(100 * area / whole).toFixed(1)} %`;
    get('legend').replaceChildren(...VERDICTS.map(([name, [r, g, b]], verdict) => {
      const line = document.createElement('div'), swatch = document.createElement('span');
      swatch.className = 'swatch';
      swatch.style.background = `rgb(${r}, ${g}, ${b})`;
      const who = verdict === 1 ? by.map(row => row.split('\t')[0]).join(', ') : '';
      line.append(swatch, `${percent(areas[verdict])} ${name}${who && `: ${who}`}`);
      return line;
    }));
    tell([`${percent(areas[0])} of ${whole.toFixed(0)} ${unit}² is reached; ${dims.join('×')} voxels of ${pitch.toPrecision(3)} ${unit}, ${seconds.toFixed(1)} s`, ...warnings].join('. '));
    draw();
  };
  get('form').addEventListener('submit', guarded(compute));

  // The tool where the pointer is: of several places that wait, the last.
  let next;
  const place = guarded(once_more(async () => {
    if (!next) return;
    const { point, axis, tip } = next, shown = tool;
    const { hit } = await ask('contact', { at: point.toArray(), axis: axis.toArray() });
    if (tool !== shown || !next) return;
    tool.position.copy(point);
    tool.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), axis);
    tool.material.color.set(hit ? 0xcd1e1e : 0x3f8f4f);
    tool.visible = true;
    reading.textContent = `${tip}${hit ? `the ${hit.element} hits, ${hit.depth.toPrecision(3)} ${unit} deep` : 'free'}`;
    draw();
  }));
  const caster = new THREE.Raycaster();
  const point_at = event => {
    if (!surface || !tool) return;
    const box = view.getBoundingClientRect();
    caster.setFromCamera(new THREE.Vector2((event.clientX - box.left) / box.width * 2 - 1, 1 - (event.clientY - box.top) / box.height * 2), camera);
    const [hit] = caster.intersectObject(surface);
    next = undefined;
    if (!hit) { tool.visible = false; reading.textContent = ''; draw(); return; }
    const angles = document.querySelector('input[name=from][value=angles]').checked;
    const axis = angles ? direction() : hit.face.normal.clone().normalize();
    // Along the surface's own normal the tool touches with its tip; else the tip alone is there.
    next = { point: hit.point.clone(), axis, tip: angles ? 'with the tip here: ' : '' };
    place();
  };
  view.addEventListener('pointermove', event => event.buttons || point_at(event));
  // A finger has no place before it touches.
  view.addEventListener('click', point_at);

  // Sections.
  const direction = () => {
    const [theta, phi] = ['theta', 'phi'].map(id => Number(get(id).value) * Math.PI / 180);
    return new THREE.Vector3(Math.sin(phi) * Math.cos(theta), Math.sin(phi) * Math.sin(theta), Math.cos(phi));
  };
  const paint = (canvas, all, [nx, ny, nz], z, most) => {
    canvas.width = nx;
    canvas.height = ny;
    const image = new ImageData(nx, ny);
    for (let x = 0; x < nx; x++) {
      for (let y = 0; y < ny; y++) {
        const step = Math.min(255, Math.max(0, Math.round(255 * all[(x * ny + y) * nz + z] / most)));
        image.data.set([...ramp.subarray(3 * step, 3 * step + 3), 255], 4 * ((ny - 1 - y) * nx + x));
      }
    }
    canvas.getContext('2d').putImageData(image, 0, 0);
  };
  const largest = all => all.reduce((most, value) => Math.max(most, value), 1e-9);
  const show_layer = () => {
    const z = Number(get('layer').value);
    const shown = compared ?? { exact: values, dims };
    if (!shown.exact) return;
    const most = largest(shown.exact);
    paint(get('exact'), shown.exact, shown.dims, Math.min(z, shown.dims[2] - 1), most);
    if (compared) paint(get('fitted'), compared.field, compared.dims, Math.min(z, compared.dims[2] - 1), most);
  };
  const show_section = once_more(async () => {
    const [theta, phi] = ['theta', 'phi'].map(id => Number(get(id).value));
    if (compared) {
      const asked_of = compared;
      get('errors').textContent = 'the field …';
      const found = await ask('compare', { theta, phi, over: get('over').value });
      if (compared !== asked_of) return;
      Object.assign(compared, found);
      get('errors').textContent = `${compared.part}, ${compared.tool}: mean squared error ${found.mse.toExponential(2)}, largest ${found.largest.toPrecision(3)}`
        + `; the field by ${found.engine} in ${found.seconds.toPrecision(2)} s`;
    } else {
      ({ values } = await ask('section', { theta, phi }));
    }
    show_layer();
  });
  const say = id => { get(id).nextElementSibling.value = id === 'layer' ? get(id).value : `${get(id).value}°`; };
  const set_layers = count => {
    get('layer').max = count - 1;
    get('layer').value = Math.floor(count / 2);
    say('layer');
  };
  for (const id of ['theta', 'phi', 'layer']) {
    get(id).addEventListener('input', guarded(async () => {
      say(id);
      if (id === 'layer') show_layer();
      // The minimum is over directions of its own.
      else if (compared ? !get('over').value : values) await show_section();
    }));
    say(id);
  }
  get('over').addEventListener('change', guarded(show_section));
  get('field').addEventListener('change', guarded(async ({ target: { files: [given] } }) => {
    if (!given) return;
    const file = await given.arrayBuffer();
    if (get('field').files[0] !== given) return;
    forget_field();
    set_layers(dims[2]);
    show_layer();
    if (waiting.size) {
      await begin();
      tell('what was computed is stopped: compute again to place the tool');
    }
    const found = await ask('field', { name: given.name, file });
    compared = { ...found };
    get('fitted').parentElement.hidden = get('over').parentElement.hidden = false;
    set_layers(found.dims[2]);
    await show_section();
  }));

  // For tests and the console.
  window.imf = { ask, compute: guarded(compute) };
  // With #check= and a question as JSON the page answers it on the console: what the module computes is compared with the library.
  const check = async () => {
    const [, question] = decodeURIComponent(location.hash).split('#check=');
    if (!question) return;
    const { part, tool, pitch, directions } = JSON.parse(question);
    const { dims } = await ask('scene', { part, file: null, tool, pitch: pitch ?? undefined });
    const { sums, seconds } = await ask('sums', { directions });
    const { triangles } = await ask('begin', { directions, samples: 1000 });
    const { areas } = await ask('advance', { count: triangles });
    const { micro } = await ask('verdicts', { count: 10000 });
    console.info(`imf answers ${JSON.stringify({ dims: [...dims], sums: [...sums], areas: [...areas], triangles, seconds, micro })} .`);
  };
  window.imf.ready = begin().then(() => {
    document.body.dataset.ready = 'yes';
    tell('ready');
    return check();
  }).catch(error => error === OTHER || tell(error.message, true));
})();
