// Networks of fields on the browser's graphics card, by the native library's own kernels: KERNELS, their texts by name, stands before
// this file. In a layer all dimensions are padded with zeros to whole tiles; crates/imf-gpu/src/layout.rs says why that alters nothing.
const TEXT = KERNELS.linear;
const constant = name => Number(TEXT.match(new RegExp(`const ${name}: u32 = (\\d+);`))[1]);
const TILE = constant('TILE'), GROUP = constant('LINEAR_GROUP');
const padded = count => Math.ceil(count / TILE) * TILE;
// Voxels of a pass, at most, and directions that coefficients are multiplied with together.
const ROWS = 4096, CHUNK = 512;

class Gpu {
  // The graphics card, or in words why there is none. A software adapter is taken only if `software` says so.
  static async open(software) {
    const adapter = await self.navigator.gpu?.requestAdapter({ powerPreference: 'high-performance' });
    if (!self.navigator.gpu) throw new Error('this browser has no WebGPU');
    if (!adapter) throw new Error('WebGPU finds no graphics card');
    if (adapter.info.isFallbackAdapter && !software) throw new Error('WebGPU has a software adapter alone');
    return new Gpu(await adapter.requestDevice(), adapter.info);
  }
  constructor(device, info) {
    this.device = device;
    this.name = [info.vendor, info.architecture].filter(Boolean).join(' ') || 'unnamed adapter';
    this.pipelines = {};
    device.lost.then(({ message }) => { this.lost = message || 'the graphics card was lost'; });
  }
  // What work gives, unless the graphics card refuses some of it.
  async guarded(work) {
    const kinds = ['validation', 'out-of-memory', 'internal'];
    kinds.forEach(kind => this.device.pushErrorScope(kind));
    const found = await work();
    const errors = await Promise.all(kinds.map(() => this.device.popErrorScope()));
    const failed = this.lost ?? errors.find(Boolean)?.message;
    if (failed) throw new Error(failed);
    return found;
  }
  buffer(bytes, usage) {
    return this.device.createBuffer({ size: Math.max(bytes, 16), usage: usage | GPUBufferUsage.COPY_DST });
  }
  storage(elements) { return this.buffer(4 * elements, GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC); }
  write(buffer, values) { this.device.queue.writeBuffer(buffer, 0, values); return buffer; }
  holding(values) { return this.write(this.storage(values.length), values); }
  // A uniform block, by the names that the kernels have for its numbers; what is not named is 0.
  uniform(block, values, into) {
    const [, body] = TEXT.match(new RegExp(`struct ${block} \\{([^}]*)\\}`));
    const fields = [...body.matchAll(/^\s*(\w+): (u32|f32),/gm)];
    const view = new DataView(new ArrayBuffer(4 * fields.length));
    fields.forEach(([, name, type], at) => view[type === 'u32' ? 'setUint32' : 'setFloat32'](4 * at, values[name] ?? 0, true));
    return this.write(into ?? this.buffer(view.byteLength, GPUBufferUsage.UNIFORM), view);
  }
  // A kernel with its buffers, to be run with so many workgroups.
  bind(kernel, buffers, ...groups) {
    const module = () => this.device.createShaderModule({ code: KERNELS[kernel] });
    const pipeline = this.pipelines[kernel] ??=
      this.device.createComputePipeline({ layout: 'auto', compute: { module: module(), entryPoint: 'main' } });
    const entries = buffers.map((buffer, binding) => ({ binding, resource: buffer.buffer ? buffer : { buffer } }));
    const group = this.device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
    return pass => { pass.setPipeline(pipeline); pass.setBindGroup(0, group); pass.dispatchWorkgroups(...groups); };
  }
  submit(dispatches) {
    const encoder = this.device.createCommandEncoder(), pass = encoder.beginComputePass();
    dispatches.forEach(dispatch => dispatch(pass));
    pass.end();
    this.device.queue.submit([encoder.finish()]);
  }
  async read(buffer, elements) {
    const copy = this.buffer(4 * elements, GPUBufferUsage.MAP_READ), encoder = this.device.createCommandEncoder();
    encoder.copyBufferToBuffer(buffer, 0, copy, 0, 4 * elements);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const values = new Float32Array(copy.getMappedRange()).slice();
    copy.destroy();
    return values;
  }
}

// A field's network and everything that it needs there.
class GpuNetwork {
  constructor(gpu, network, voxels) {
    Object.assign(this, { gpu, network, voxels, rows: Math.min(ROWS, padded(voxels)) });
    const flat = network.layers(), layers = [];
    for (let at = 0; at < flat.length; at += 5) {
      const [inputs, outputs, weights, biases, skip] = flat.subarray(at, at + 5);
      layers.push({ inputs, outputs, weights, biases, skip });
    }
    const parameters = this.place(layers, network.parameters());
    const signals = [0, 1].map(() => gpu.storage(this.rows * Math.max(...layers.map(layer => layer.columns))));
    const last = layers.at(-1), rows = this.rows / GROUP, block = padded(network.inputs);
    this.width = last.rows;
    this.batch = gpu.uniform('Batch', {});
    this.sweep = gpu.uniform('Sweep', {});
    this.points = gpu.storage(this.rows * network.inputs);
    this.direction = gpu.storage(2);
    this.least = gpu.storage(padded(voxels));
    this.best = gpu.storage(this.rows);
    this.results = gpu.storage(this.rows * last.rows);
    const inputs = (layer, offset, signal) => {
      const placement = gpu.uniform('Placement', { stride: layer.columns, offset, columns: block, inputs: network.inputs });
      return network.sees_directions
        ? gpu.bind('poses', [this.batch, placement, this.sweep, this.points, this.direction, signal], rows)
        : gpu.bind('inputs', [this.batch, placement, this.points, signal], rows);
    };
    this.pass = [];
    layers.forEach((layer, index) => {
      const [from, to] = [signals[index % 2], signals[(index + 1) % 2]];
      if (index === 0) this.pass.push(inputs(layer, 0, from));
      if (layer.skip) this.pass.push(inputs(layer, layer.columns - block, from));
      this.last = gpu.uniform('Layer', {
        inputs: layer.columns, outputs: layer.rows, weights: layer.at, biases: layer.at + layer.rows * layer.columns,
        stride: layers[index + 1]?.columns ?? layer.rows, omega: network.omega,
      });
      const [kernel, target] = layer === last ? ['linear', this.results] : ['hidden_evaluate', to];
      this.pass.push(gpu.bind(kernel, [this.batch, this.last, parameters, from, target], layer.rows / TILE, this.rows / TILE));
    });
    this.values = gpu.storage(this.rows * (network.sees_directions ? 1 : CHUNK));
    if (network.sees_directions) this.pass.push(gpu.bind('outputs', [this.batch, this.last, this.sweep, this.results, this.values], rows));
    const degree = network.turned_degree;
    if (degree !== undefined) {
      this.frames = gpu.storage(3 * this.rows);
      const harmonics = gpu.uniform('Harmonics', { degree, stride: last.rows });
      this.pass.push(gpu.bind('local_frames', [this.batch, harmonics, this.frames, this.results], rows * (degree + 1)));
    }
  }
  // The parameters with padding; of every layer where it begins, its rows and its columns.
  place(layers, flat) {
    let end = 0;
    for (const layer of layers) {
      const own = layer.skip ? layer.inputs - this.network.inputs : layer.inputs;
      Object.assign(layer, { own, at: end, rows: padded(layer.outputs), columns: padded(own) + (layer.skip ? padded(this.network.inputs) : 0) });
      end += layer.rows * (layer.columns + 1);
    }
    const all = new Float32Array(end);
    for (const { inputs, outputs, weights, biases, own, at, rows, columns } of layers) {
      for (let row = 0; row < outputs; row++) {
        const from = flat.subarray(weights + row * inputs, weights + (row + 1) * inputs);
        all.set(from.subarray(0, own), at + row * columns);
        all.set(from.subarray(own), at + row * columns + padded(own));
      }
      all.set(flat.subarray(biases, biases + outputs), at + rows * columns);
    }
    return this.gpu.holding(all);
  }
  // Coefficients multiplied with some directions: `weights` [direction][coefficients], and a constant each.
  product(weights, constants, first) {
    const { gpu, width } = this, count = constants.length, columns = padded(count), own = weights.length / count;
    const all = new Float32Array(columns * (width + 1));
    for (let row = 0; row < count; row++) all.set(weights.subarray(row * own, (row + 1) * own), row * width);
    all.set(constants, columns * width);
    const layer = gpu.uniform('Layer', { inputs: width, outputs: columns, weights: 0, biases: columns * width, stride: columns });
    const sweep = gpu.uniform('Sweep', { directions: count, first_direction: first });
    const dispatch = gpu.bind('linear', [this.batch, layer, gpu.holding(all), this.results, this.values], columns / TILE, this.rows / TILE);
    return { dispatch, then: (least, best) => gpu.bind('row_minimum', [this.batch, layer, sweep, this.values, least, best], this.rows / GROUP) };
  }
  // The minimum over the directions at every voxel, not clipped; `progress` gets the fraction that is done.
  async minimum(directions, progress) {
    const { gpu, network, voxels, sweep, best } = this, given = network.directions(directions), products = [];
    const count = network.sees_directions ? given.length / 2 : directions.count;
    const own = given.length / count - 1;
    for (let first = 0; first < count && !network.sees_directions; first += CHUNK) {
      const end = Math.min(first + CHUNK, count), constants = count * own;
      products.push(this.product(given.subarray(first * own, end * own), given.subarray(constants + first, constants + end), first));
    }
    for (let first = 0; first < voxels; first += this.rows) {
      const rows = Math.min(this.rows, voxels - first);
      const least = { buffer: this.least, offset: 4 * first, size: 4 * rows };
      gpu.uniform('Batch', { rows, padded_rows: padded(rows) }, this.batch);
      gpu.write(this.points, network.points(first, rows));
      if (this.frames) gpu.write(this.frames, network.frames(first, rows));
      if (network.sees_directions) {
        const minimum = gpu.bind('minimum', [sweep, this.values, least, best], this.rows / GROUP);
        for (let direction = 0; direction < count; direction++) {
          gpu.uniform('Sweep', { points: rows, directions: 1, first_direction: direction }, sweep);
          gpu.write(this.direction, given.subarray(2 * direction, 2 * direction + 2));
          gpu.submit([...this.pass, minimum]);
        }
      } else {
        gpu.submit([...this.pass, ...products.flatMap(({ dispatch, then }) => [dispatch, then(least, best)])]);
      }
      await gpu.device.queue.onSubmittedWorkDone();
      if (gpu.lost) throw new Error(gpu.lost);
      progress((first + rows) / voxels);
    }
    return gpu.read(this.least, voxels);
  }
}
