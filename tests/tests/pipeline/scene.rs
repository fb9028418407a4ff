//! What the tests compute with: reference parts under the paper's tool, and their samples.

use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::{SectionPlan, ToolPoints};
use imf_core::tool::Tool;
use imf_fields::recipe::Sampling;
use imf_train::dataset::{self, Manifest};
use imf_train::samples::Samples;

/// A seventh of the paper's grid of the bracket: 1,764 voxels of 7 mm, no side a multiple of a tile.
const SMALL: [usize; 3] = [7, 21, 12];

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
    SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap()
}

/// A set of orientations from its text.
pub(crate) fn orientations(spec: &str) -> OrientationSet {
    OrientationSet::parse(spec).unwrap()
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
