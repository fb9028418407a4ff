//! What the tests compute with: reference parts under the paper's tool, their samples, and the machine's adapter.

use imf_core::control::Control;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{At, SectionPlan};
use imf_core::tool::Tool;
use imf_fields::recipe::Sampling;
use imf_gpu::{DeviceChoice, Gpu};
use imf_train::dataset::{self, Manifest};
use imf_train::samples::Samples;

/// A seventh of the paper's grid of the bracket: 1,764 voxels of 7 mm, no side a multiple of a tile.
pub(crate) const SMALL: [usize; 3] = [7, 21, 12];

/// A reference part under the paper's tool.
pub(crate) fn scene(part: ReferencePart, dims: [usize; 3]) -> Scene {
    let mesh = part.mesh();
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(part, &mesh, dims, &tool);
    spec.scene().unwrap()
}

/// The small bracket.
pub(crate) fn bracket() -> Scene {
    scene(ReferencePart::Bracket, SMALL)
}

/// A scene's sections.
pub(crate) fn plan(scene: &Scene) -> SectionPlan {
    SectionPlan::new(&scene.obstacle, &scene.record.tool, At::SharpPoints).unwrap()
}

/// A set of orientations from its text.
pub(crate) fn orientations(spec: &str) -> OrientationSet {
    OrientationSet::parse(spec).unwrap()
}

/// Angles of the tool's axis, as networks take them.
pub(crate) fn angles(set: &OrientationSet) -> Vec<[f32; 2]> {
    set.orientations.iter().map(Orientation::angles).collect()
}

/// The samples of a scene as training gets them: written to a dataset and read back.
pub(crate) fn samples(scene: &Scene, set: &OrientationSet, density: f64) -> (Manifest, Samples) {
    let folder = tempfile::tempdir().unwrap();
    let sampling = Sampling { density, ..Sampling::default() };
    dataset::generate(folder.path(), scene, set, &sampling, Control::quiet()).unwrap();
    let (manifest, read, samples) = dataset::load(folder.path()).unwrap();
    assert_eq!(read, *scene, "a dataset carries its scene");
    (manifest, samples)
}

/// The machine's adapter, software included. Tests that need one fail without one, unless `IMF_NO_GPU_TESTS=1` was
/// set when they were built; then the runner reports them as ignored.
pub(crate) fn adapter() -> Gpu {
    Gpu::open(&DeviceChoice::Any).unwrap_or_else(|error| {
        panic!("{error}.\nTo leave these tests out on purpose: IMF_NO_GPU_TESTS=1 cargo test")
    })
}

/// Runs work on a pool of so many threads.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// Bit patterns, so that equal means equal.
pub(crate) fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}
