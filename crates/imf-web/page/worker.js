// After wasm-bindgen's own script and gpu.js, in a worker: answers messages { id, ask, … } by { id, … }, one after the other; before that
// comes { id, done }, the fraction that is done, of what takes long.
const post = (id, answer, moved) => self.postMessage({ id, ...answer }, moved ?? []);
let scene, access;
// A field, its network, the same on the graphics card, and in words why it is not there.
let field, own, gpu, on_gpu, without_gpu;

const asks = {
  async start({ module }) {
    const packed = Uint8Array.from(atob(module), c => c.charCodeAt(0));
    const bytes = new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
    await wasm_bindgen({ module_or_path: await bytes });
    return { ramp: wasm_bindgen.ramp(256) };
  },
  scene({ part, file, name, unit, tool, pitch }) {
    const mesh = file ? wasm_bindgen.Part.read(name, new Uint8Array(file), unit) : wasm_bindgen.Part.reference(part);
    scene?.free();
    scene = undefined;
    scene = new wasm_bindgen.PartScene(mesh, tool, pitch);
    const { warnings, dims, pitch: used, unit: own } = scene;
    return { corners: mesh.corners(), tool: scene.tool_corners(), warnings, dims, pitch: used, unit: own };
  },
  begin({ directions, samples }) {
    access?.free();
    access = undefined;
    access = new wasm_bindgen.SurfaceAccess(scene, directions, samples);
    return { triangles: access.triangles };
  },
  advance({ count }) {
    const left = access.advance(count);
    return left > 0 ? { left } : { left, corners: access.corners(), verdicts: access.verdicts(), areas: access.areas(), by: access.obstructed_by() };
  },
  contact({ at: [x, y, z], axis: [i, j, k] }) {
    const hit = scene.contact(x, y, z, i, j, k);
    return { hit: hit && { element: hit.element, depth: hit.depth } };
  },
  section({ theta, phi }) {
    return { values: scene.section(theta, phi) };
  },
  sums({ directions }) {
    const begun = performance.now();
    return { sums: scene.section_sums(directions), seconds: 0.001 * (performance.now() - begun) };
  },
  verdicts({ count }) {
    const [x, y, z] = scene.dims, pitch = scene.pitch, [ox, oy, oz] = scene.origin;
    let free = 0, seed = 1;
    const next = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
    const begun = performance.now();
    for (let pose = 0; pose < count; pose++) {
      free += scene.contact(ox + x * pitch * next(), oy + y * pitch * next(), oz + z * pitch * next(), next() - 0.5, next() - 0.5, next() - 0.5) ? 0 : 1;
    }
    return { free, micro: 1000 * (performance.now() - begun) / count };
  },
  async field({ name, file, software }) {
    [field, own].forEach(old => old?.free());
    field = own = on_gpu = undefined;
    field = wasm_bindgen.FieldFile.read(name, new Uint8Array(file));
    own = field.network();
    const voxels = field.dims.reduce((product, count) => product * count, 1);
    try {
      if (!own) throw new Error('harmonic fields have no network');
      if (!gpu || gpu.lost) gpu = await Gpu.open(software);
      on_gpu = await gpu.guarded(() => new GpuNetwork(gpu, own, voxels));
    } catch (error) {
      without_gpu = error.message;
    }
    return { part: field.part, tool: field.tool, dims: field.dims };
  },
  async compare({ theta, phi, over }, told) {
    const directions = over ? wasm_bindgen.Directions.read(over) : wasm_bindgen.Directions.one(theta, phi);
    const begun = performance.now();
    let values, engine;
    if (on_gpu) {
      try {
        values = field.clamped(await gpu.guarded(() => on_gpu.minimum(directions, told)));
        engine = `WebGPU (${gpu.name})`;
      } catch (error) {
        [on_gpu, without_gpu] = [undefined, error.message];
      }
    }
    if (!values) {
      values = field.minimum(directions, told);
      engine = `WebAssembly (${without_gpu})`;
    }
    const seconds = 0.001 * (performance.now() - begun);
    const found = field.compare(directions, values);
    return { field: values, exact: found.exact(), mse: found.mse, largest: found.largest, engine, seconds };
  },
};

// What a panic says, which the module writes on the console before it ends.
let said;
const write = console.error;
console.error = (...words) => { said = words.join(' '); write(...words); };
// A module that has ended answers nothing any more: `broken` says so.
// A stack that overflows is a RangeError.
const failure = error => error instanceof WebAssembly.RuntimeError || error instanceof RangeError
  ? { broken: true, error: `the computation has ended: ${said ?? 'it ran out of memory, most likely; choose larger voxels'}` }
  : { error: String(error?.message ?? error) };
let last = Promise.resolve();
self.onmessage = ({ data: { id, ask, ...rest } }) => {
  last = last.then(() => asks[ask](rest, done => post(id, { done }))).then(answer => post(id, answer), error => post(id, failure(error)));
};
