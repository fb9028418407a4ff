//! Coefficients of points that lie on the device, multiplied with orientations there, and the minimum of the values
//! over these. The caller provides the coefficients, from a network or a field that holds them: it returns the buffer
//! with those of some points.
//!
//! ```text
//! coefficients [points][components] × directions [components][orientations of a chunk] → values → sections [orientation][point]
//!                                                                              → running minimum
//! ```
//!
//! The product is the shader of a linear layer, whose weights are an orientation's functions and whose bias is its mean.

use std::collections::VecDeque;
use std::ops::Range;

use imf_core::field::EngineError;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, Quantity};
use imf_fields::factored::FactoredField;
use imf_fields::harmonic::{DIRECTIONS_AT_ONCE, DirectionWeights, HarmonicField};

use crate::device::Gpu;
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::memory::{Room, allocate};
use crate::shader::{Shader, TILE};
use crate::transfer::Reading;
use crate::uniforms::{Layer, Sweep};

/// Points whose coefficients lie together, at most.
pub(crate) const ROWS: usize = 1 << 14;
/// Orientations of one product, at most: values of [`ROWS`] points are 32 MiB.
const CHUNK: usize = 512;
/// Copies that wait to be read by the host while the device goes on.
const READINGS: usize = 4;

/// How coefficients lie, `[rows][columns]`.
#[derive(Clone, Debug)]
pub(crate) struct CoefficientRows {
    /// The rows at hand.
    pub(crate) batch: wgpu::Buffer,
    /// Points, at most.
    pub(crate) rows: usize,
    /// Coefficients of a point, padding among them.
    pub(crate) columns: usize,
}

impl CoefficientRows {
    /// Says how many points lie there.
    pub(crate) fn hold(&self, gpu: &Gpu, rows: usize) {
        gpu.write(&self.batch, &[gpu.batch_of(rows)]);
    }
}

/// Multiplies coefficients with orientations.
#[derive(Debug)]
pub(crate) struct OverOrientations {
    gpu: Gpu,
    rows: CoefficientRows,
    /// Orientations of a chunk, and of all chunks that are on the device together.
    chunk: usize,
    batch: usize,
    values: wgpu::Buffer,
    sections: Room,
    least: wgpu::Buffer,
    best: wgpu::Buffer,
    product: Kernel,
    section: Kernel,
    minimum: Kernel,
}

/// Some orientations on the device.
struct Chunk {
    /// What they are multiplied with, and how.
    uploaded: wgpu::Buffer,
    layer: wgpu::Buffer,
    /// Reduces the values.
    then: Dispatch,
    /// Their range among those that were uploaded together.
    orientations: Range<usize>,
    /// As many, and padding.
    columns: usize,
}

/// How many rows of coefficients a device takes at a time, `wanted` at most: as many as one binding holds beside a chunk's values.
pub(crate) fn rows_within(gpu: &Gpu, columns: usize, wanted: usize) -> usize {
    let limits = gpu.limits();
    let padding = gpu.matrix_kernel().padding();
    let rows = wanted
        .min(limits.elements() / columns.max(chunk(gpu)))
        .min(limits.workgroups as usize * TILE as usize);
    (rows / padding * padding).max(padding)
}

/// Orientations of a chunk.
fn chunk(gpu: &Gpu) -> usize {
    CHUNK.next_multiple_of(gpu.matrix_kernel().padding())
}

impl OverOrientations {
    /// Compiles the kernels, and allocates what they write.
    pub(crate) fn new(gpu: &Gpu, rows: CoefficientRows) -> Result<Self, EngineError> {
        let chunk = chunk(gpu);
        let batch = DIRECTIONS_AT_ONCE.min(gpu.limits().elements() / (rows.columns + 1)) / chunk * chunk;
        let sizes = [("values", rows.rows * chunk), ("minima", rows.rows), ("best orientations", rows.rows)];
        let [values, least, best] = allocate(gpu, sizes)?;
        Ok(Self {
            gpu: gpu.clone(),
            rows,
            chunk,
            batch: batch.max(chunk),
            values,
            sections: Room::new("sections"),
            least,
            best,
            product: Kernel::new(gpu, Shader::Linear)?,
            section: Kernel::new(gpu, Shader::RowSections)?,
            minimum: Kernel::new(gpu, Shader::RowMinimum)?,
        })
    }

    /// The minimum over the orientations at `points` points, not clipped, with the first orientation that attains it.
    /// `source` gives the values' orientation weights. `fill` submits the coefficients of a range of points into the
    /// buffer that it returns, and may end the work by an error; it is called for every batch of orientations, with
    /// the batch's number of orientations. Waits for the device.
    pub(crate) fn minimum<E: From<EngineError>>(
        &mut self,
        points: usize,
        orientations: &[Orientation],
        source: Source<'_>,
        mut fill: impl FnMut(Range<usize>, usize) -> Result<wgpu::Buffer, E>,
    ) -> Result<Imf, E> {
        require(orientations)?;
        let mut found = Imf::new(points);
        for (batch, orientations) in orientations.chunks(self.batch).enumerate() {
            let chunks = self.chunks(source, orientations, None)?;
            let first = (batch * self.batch) as u32;
            let gpu = self.gpu.clone();
            let mut readings = Readings::new(|(part, least, best): (Range<usize>, Reading, Reading)| {
                let (least, best) = (gpu.finish_read::<f32>(least)?, gpu.finish_read::<u32>(best)?);
                let lowest = found.value[part.clone()].iter_mut().zip(&mut found.best[part]);
                for ((lowest, chosen), (least, best)) in lowest.zip(least.into_iter().zip(best)) {
                    // Where values are NaN the first batch's stays, as within a batch.
                    if batch == 0 || least < *lowest {
                        (*lowest, *chosen) = (least, first + best);
                    }
                }
                Ok(())
            });
            for part in self.parts(points) {
                let rows = part.len();
                let coefficients = fill(part.clone(), orientations.len())?;
                for chunk in &chunks {
                    self.submit(chunk, &coefficients, rows)?;
                }
                let read = |buffer| gpu.begin_read(buffer, rows);
                readings.add((part, read(&self.least)?, read(&self.best)?))?;
            }
            readings.finish()?;
        }
        Ok(found)
    }

    /// Values of `points` points in every orientation, clamped as their quantity is, into
    /// `sections[orientation][point]`. `source` and `fill` are as of [`Self::minimum`].
    pub(crate) fn sections<E: From<EngineError>>(
        &mut self,
        points: usize,
        orientations: &[Orientation],
        source: Source<'_>,
        sections: &mut [f32],
        mut fill: impl FnMut(Range<usize>) -> Result<wgpu::Buffer, E>,
    ) -> Result<(), E> {
        require(orientations)?;
        let (quantity, pitch) = source.quantity();
        let all = orientations.chunks(self.batch).zip(sections.chunks_mut((self.batch * points).max(1)));
        for (orientations, sections) in all {
            let gpu = self.gpu.clone();
            let room = self.sections.fit(&gpu, self.rows.rows * self.chunk.min(orientations.len()))?;
            let chunks = self.chunks(source, orientations, Some(&room))?;
            let mut readings = Readings::new(|(part, of, reading): (Range<usize>, Range<usize>, Reading)| {
                let values = gpu.finish_read::<f32>(reading)?;
                for (orientation, values) in of.zip(values.chunks_exact(part.len())) {
                    let section = sections[orientation * points..][part.clone()].iter_mut().zip(values);
                    section.for_each(|(out, &value)| *out = quantity.clamp(value, pitch));
                }
                Ok(())
            });
            for part in self.parts(points) {
                let rows = part.len();
                let coefficients = fill(part.clone())?;
                for chunk in &chunks {
                    let of = chunk.orientations.clone();
                    self.submit(chunk, &coefficients, rows)?;
                    let reading = gpu.begin_read(&room, rows * of.len())?;
                    readings.add((part.clone(), of, reading))?;
                }
            }
            readings.finish()?;
        }
        Ok(())
    }

    /// Ranges of `points` points that fit on the device one after the other.
    fn parts(&self, points: usize) -> impl Iterator<Item = Range<usize>> + use<> {
        let rows = self.rows.rows;
        (0..points).step_by(rows).map(move |first| first..(first + rows).min(points))
    }

    /// Uploads what orientations are multiplied with: `[column][components]` and their means, a chunk behind the other. Values
    /// go to `sections`, or else lower the minimum.
    fn chunks(
        &self,
        source: Source<'_>,
        orientations: &[Orientation],
        sections: Option<&wgpu::Buffer>,
    ) -> Result<Vec<Chunk>, EngineError> {
        let (directions, scale) = source.direction_weights(orientations);
        let (count, components) = (directions.len(), directions.along().len() / directions.len());
        let Self { gpu, rows: CoefficientRows { batch, columns: inputs, .. }, .. } = self;
        let mut weights = Vec::new();
        let mut places = Vec::new();
        for first in (0..count).step_by(self.chunk) {
            let orientations = first..(first + self.chunk).min(count);
            let columns = orientations.len().next_multiple_of(gpu.matrix_kernel().padding());
            let at = weights.len();
            weights.resize(at + columns * (*inputs + 1), 0.0);
            let (rows, biases) = weights[at..].split_at_mut(columns * *inputs);
            for (orientation, row) in orientations.clone().zip(rows.chunks_exact_mut(*inputs)) {
                for (axis, weight) in row[..components].iter_mut().enumerate() {
                    *weight = directions.along()[axis * count + orientation] * scale;
                }
            }
            biases[..orientations.len()].copy_from_slice(&directions.constants()[orientations.clone()]);
            places.push((at, orientations, columns));
        }
        let [uploaded] = allocate(gpu, [("orientations", weights.len())])?;
        gpu.write(&uploaded, &weights);
        let chunk = |(at, orientations, columns): (usize, Range<usize>, usize)| {
            let layer = Layer {
                inputs: *inputs as u32,
                outputs: columns as u32,
                weights: at as u32,
                biases: (at + columns * *inputs) as u32,
                stride: columns as u32,
                ..Layer::default()
            };
            let layer = uniform(gpu, "orientations", &layer)?;
            let sweep = Sweep {
                directions: orientations.len() as u32,
                first_direction: orientations.start as u32,
                ..Sweep::default()
            };
            let sweep = uniform(gpu, "sweep", &sweep)?;
            let front = [batch, &layer, &sweep, &self.values];
            let then = match sections {
                Some(sections) => {
                    let extent = Extent::Rows(orientations.len());
                    self.section.bind(extent, &[&front[..], &[sections]].concat())
                }
                None => {
                    self.minimum.bind(Extent::Rows(1), &[&front[..], &[&self.least, &self.best]].concat())
                }
            };
            Ok(Chunk { uploaded: uploaded.clone(), layer, then, orientations, columns })
        };
        places.into_iter().map(chunk).collect()
    }

    /// Submits the product of `rows` rows of coefficients with a chunk of orientations, and what is computed from its
    /// values.
    fn submit(&self, chunk: &Chunk, coefficients: &wgpu::Buffer, rows: usize) -> Result<(), EngineError> {
        let Self { gpu, product, rows: CoefficientRows { batch, .. }, values, .. } = self;
        let buffers = [batch, &chunk.layer, &chunk.uploaded, coefficients, values];
        let product = product.bind(Extent::Product(chunk.columns), &buffers);
        gpu.run([&product, &chunk.then], gpu.batch_of(rows))
    }
}

/// Copies on their way to the host, and what takes them: the device goes on to other points while the host takes what was found of
/// the oldest, and prepares the next.
struct Readings<T, F> {
    waiting: VecDeque<T>,
    take: F,
}

impl<T, F: FnMut(T) -> Result<(), EngineError>> Readings<T, F> {
    fn new(take: F) -> Self {
        Self { waiting: VecDeque::new(), take }
    }

    fn add(&mut self, reading: T) -> Result<(), EngineError> {
        self.waiting.push_back(reading);
        if self.waiting.len() <= READINGS {
            return Ok(());
        }
        self.waiting.pop_front().map_or(Ok(()), &mut self.take)
    }

    fn finish(self) -> Result<(), EngineError> {
        self.waiting.into_iter().try_for_each(self.take)
    }
}

fn require(orientations: &[Orientation]) -> Result<(), EngineError> {
    if orientations.is_empty() {
        return Err(EngineError::Shape("a field needs at least one orientation".to_owned()));
    }
    Ok(())
}

/// The source of the orientations' weights.
#[derive(Clone, Copy)]
pub(crate) enum Source<'a> {
    Harmonic(&'a HarmonicField),
    /// Its coefficients lie on the device over its scale.
    Factored(&'a FactoredField),
}

impl Source<'_> {
    /// Orientations as the field reads them, and the scale of its coefficients.
    fn direction_weights(self, orientations: &[Orientation]) -> (DirectionWeights, f32) {
        match self {
            Self::Harmonic(field) => (field.direction_weights(orientations), 1.0),
            Self::Factored(field) => (field.direction_weights(orientations), field.scale),
        }
    }

    /// What its values are, and the pitch of its grid.
    pub(crate) fn quantity(self) -> (Quantity, f64) {
        match self {
            Self::Harmonic(field) => (field.quantity, field.grid.pitch),
            Self::Factored(field) => (field.quantity, field.grid.pitch),
        }
    }
}
