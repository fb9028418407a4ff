//! `imf-bench edits`: what a trained network of the paper's saves where its part is changed a little.
//!
//! A ball of the bracket's material is taken away, or added, so large that a stated fraction of its voxels changes.
//! The network of the part before is trained on at the new part, in more and more steps, until it errs as little as a
//! network that learns the new part from random weights. Two ways to draw its samples: everywhere as usual, or half
//! of them where the exact section has changed, which is where the tool can reach the change.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use imf_cli::engine::Device;
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::Scene;
use imf_core::section::{SectionPlan, ToolPoints, sections};
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{
    Cursor, HeldOutChoice, Precision, Sampling, TrainingLength, TrainingPlan, TrainingState,
};
use imf_fields::siren::SirenShape;
use imf_train::dataset::draw;
use imf_train::engine::{CpuEvaluator, CpuTrainer};
use imf_train::held_out::HeldOut;
use imf_train::samples::Samples;
use imf_train::training::TrainingEngine as _;
use imf_train::training::run::train;
use serde::Serialize;
use std::ops::ControlFlow;

use crate::candidates::reference_scene;
use crate::document::Document;
use crate::measurement::{Machine, seconds};
use crate::paper::precision_on;

/// What the network of a part saves where the part is changed a little
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench edits --out edits\n\n\
                        Writes edits.json and edits.md. Some minutes on 2 cores.")]
pub(crate) struct EditsArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// Resolution of the bracket, over its own along each axis
    #[arg(long, default_value_t = 0.5, value_name = "SHARE", value_parser = parse_scale)]
    scale: f64,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = 128, value_name = "N")]
    width: usize,
    /// Learning rate of the old network over that of a new one
    #[arg(long, default_value_t = 0.2, value_name = "SHARE")]
    rate: f32,
    /// Steps from random weights
    #[arg(long, default_value_t = 12_000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
}

/// Below, the bracket is a handful of voxels; above, its sections take many times the memory of its own resolution.
fn parse_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse().ok().filter(|scale| (0.05..=1.0).contains(scale));
    scale.ok_or_else(|| "not a share from 0.05 to 1".to_owned())
}

/// Fractions of the part's voxels that change.
const SHARES: [f64; 3] = [0.001, 0.01, 0.05];
/// Steps in which the old network is tried, over those from random weights.
const BUDGETS: [f64; 6] = [0.0125, 0.025, 0.05, 0.1, 0.2, 0.4];
/// An error that is as good as another: two trainings from other random weights differ by as much.
const AS_GOOD: f64 = 1.05;
const ORIENTATIONS: &str = "fibonacci:225";
const HELD_OUT: HeldOutChoice = HeldOutChoice { poses: 1 << 16, orientations: 64, seed: 1 };

/// How an old network's samples are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
enum SamplePlacement {
    Everywhere,
    /// Half of them where the exact section has changed.
    NearTheChange,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    network: SirenShape,
    precision: Precision,
    steps: u64,
    edits: Vec<Edit>,
}

/// A changed part.
#[derive(Serialize)]
struct Edit {
    /// Material is taken away, not added.
    taken: bool,
    /// Of the part's voxels.
    share: f64,
    /// Mean squared error of the network as it was.
    as_it_was: f64,
    /// From random weights.
    anew: Trial,
    adapted: Vec<(SamplePlacement, Vec<Trial>)>,
}

/// A training, sampling included.
#[derive(Clone, Copy, Serialize)]
struct Trial {
    steps: u64,
    seconds: f64,
    mse: f64,
}

struct Lab {
    /// Rate of the old network over that of a new one.
    rate: f32,
    shape: SirenShape,
    precision: Precision,
    steps: u64,
    directions: OrientationSet,
}

pub(crate) fn run(session: &Session, arguments: &EditsArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let lab = Lab {
        rate: arguments.rate,
        shape: SirenShape { width: arguments.width, ..SirenShape::default() },
        precision: precision_on(&Device::Cpu),
        steps: arguments.steps,
        directions: OrientationSet::parse(ORIENTATIONS)?,
    };
    let mut machine = Machine::new(session.threads());
    let before = reference_scene(ReferencePart::Bracket, arguments.scale)?;
    let old_sections = lab.sections(&before)?;
    session.note(&format!("the part as it was, {} voxels", before.obstacle.count()));
    let (old, _) = lab.trained(&before, &lab.samples(&before, &old_sections, None), None, lab.steps)?;
    let mut edits = Vec::new();
    for share in SHARES {
        for taken in [true, false] {
            session.note(&format!("{} % {}", 100.0 * share, if taken { "taken away" } else { "added" }));
            edits.push(lab.edit(&before, &old_sections, &old, share, taken)?);
        }
    }
    machine.finish();
    let (network, precision, steps) = (lab.shape, lab.precision, lab.steps);
    let report = Report { machine, network, precision, steps, edits };
    report.document().write(&arguments.out, "edits", &report)?.show(session, &report)
}

impl Lab {
    fn sections(&self, scene: &Scene) -> Result<Vec<Vec<f32>>> {
        let plan = SectionPlan::of_scene(scene, ToolPoints::Tip)?;
        Ok(sections(&plan, &self.directions.orientations, Control::quiet())?)
    }

    /// Samples of a scene's sections, half of them where these differ from those `before` where there are some.
    fn samples(&self, scene: &Scene, own: &[Vec<f32>], before: Option<&[Vec<f32>]>) -> Samples {
        let mut samples = Samples::new(scene.record.grid);
        let usual = Sampling::default();
        for (index, (section, orientation)) in own.iter().zip(&self.directions.orientations).enumerate() {
            let mut voxels = draw(section, &usual, index as u64);
            if let Some(before) = before {
                // A draw that treats changed values as those above 0, and retains only them.
                let changed: Vec<f32> =
                    section.iter().zip(&before[index]).map(|(a, b)| f32::from(u8::from(a != b))).collect();
                let near = Sampling { positive_fraction: 1.0, ..usual };
                let near =
                    draw(&changed, &near, index as u64).into_iter().filter(|&v| changed[v as usize] > 0.0);
                voxels.extend(near);
            }
            let values: Vec<f32> = voxels.iter().map(|&voxel| section[voxel as usize]).collect();
            samples.push_section(orientation.angles(), &voxels, &values);
        }
        samples
    }

    /// A network's weights after a number of steps, and the result of the training.
    fn trained(
        &self,
        scene: &Scene,
        samples: &Samples,
        from: Option<&[f32]>,
        steps: u64,
    ) -> Result<(Vec<f32>, Trial)> {
        let begun = Instant::now();
        let state = match from {
            Some(weights) => TrainingState::from_parameters(weights.to_vec()),
            None => TrainingState::new(&self.shape, 0),
        };
        let share = if from.is_some() { self.rate } else { 1.0 };
        let plan = TrainingPlan {
            length: TrainingLength::Steps(steps),
            schedule: Schedule::Cosine {
                initial: share * self.shape.rate(),
                last: 0.0,
                warmup: 200.min(steps / 10),
            },
            ..TrainingPlan::default()
        };
        let mut engine = CpuTrainer::new(self.shape.stack(), plan.adam, plan.loss, plan.batch, state)?
            .with_precision(self.precision)?;
        train(&plan, samples, &mut engine, Cursor::default(), &mut |_, _| ControlFlow::Continue(()))?;
        let weights = engine.weights()?;
        let seconds = begun.elapsed().as_secs_f64();
        let mse = self.error(scene, &weights)?;
        Ok((weights, Trial { steps, seconds, mse }))
    }

    fn error(&self, scene: &Scene, weights: &[f32]) -> Result<f64> {
        let mut held_out = HeldOut::new(HELD_OUT, scene, &self.directions.orientations, Control::quiet())?;
        let mut engine = CpuEvaluator::new(self.shape, weights)?;
        Ok(held_out.errors(&mut engine)?.mse)
    }

    fn edit(
        &self,
        before: &Scene,
        old_sections: &[Vec<f32>],
        old: &[f32],
        share: f64,
        taken: bool,
    ) -> Result<Edit> {
        let scene = Scene { obstacle: changed(&before.obstacle, share, taken), ..before.clone() };
        let (exact, own) = seconds(|| self.sections(&scene))?;
        let (drawing, everywhere) = seconds(|| Ok(self.samples(&scene, &own, None)))?;
        let (_, mut anew) = self.trained(&scene, &everywhere, None, self.steps)?;
        anew.seconds += exact + drawing;
        let mut adapted = Vec::new();
        for drawn in [SamplePlacement::Everywhere, SamplePlacement::NearTheChange] {
            let near = (drawn == SamplePlacement::NearTheChange).then_some(old_sections);
            let (drawing, samples) = seconds(|| Ok(self.samples(&scene, &own, near)))?;
            let mut trials = Vec::new();
            for budget in BUDGETS {
                let steps = ((self.steps as f64 * budget).round() as u64).max(1);
                let (_, mut trial) = self.trained(&scene, &samples, Some(old), steps)?;
                trial.seconds += exact + drawing;
                trials.push(trial);
                if trial.mse <= AS_GOOD * anew.mse {
                    break;
                }
            }
            adapted.push((drawn, trials));
        }
        let as_it_was = self.error(&scene, old)?;
        Ok(Edit { taken, share, as_it_was, anew, adapted })
    }
}

/// The part without a ball around the middle of its surface, or with one more: the ball is as large as the fraction
/// requires.
fn changed(part: &Occupancy, share: f64, taken: bool) -> Occupancy {
    let grid = part.grid;
    let wanted = (share * part.count() as f64).round().max(1.0) as usize;
    // Somewhere on the surface: the first solid voxel from one side, half-way through the others.
    let centre = (0..grid.len()).filter(|&index| part.solid[index] != 0).nth(part.count() / 3).unwrap_or(0);
    let middle = grid.centre(grid.voxel(centre));
    let mut may: Vec<usize> = (0..grid.len()).filter(|&index| (part.solid[index] != 0) == taken).collect();
    let distance = |index: usize| (grid.centre(grid.voxel(index)) - middle).length_squared();
    may.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
    let mut solid = part.solid.clone();
    for &index in may.iter().take(wanted) {
        solid[index] = u8::from(!taken);
    }
    Occupancy { grid, solid }
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("A changed part, and the network that was there");
        document.paragraph(format!("{}, products in {}", self.machine, self.precision));
        document.paragraph(format!(
            "{}×{} with ω = {}, {} steps from random weights; MSE at 65,536 poses of 64 directions that no training saw. A ball of \
             material is taken from the bracket or added to it. Steps and seconds are the fewest of those tried after which the old \
             network errs at most a twentieth more than the new one; seconds include the exact sections of the changed part and \
             the drawing of its samples.",
            self.network.hidden, self.network.width, self.network.omega, self.steps
        ));
        let head = [
            "change",
            "network as it was",
            "from random weights",
            "seconds",
            "samples",
            "adapted",
            "steps",
            "seconds",
            "share of the time",
        ];
        let mut rows = Vec::new();
        for edit in &self.edits {
            for (drawn, trials) in &edit.adapted {
                let Some(last) = trials.last() else { continue };
                let met = last.mse <= AS_GOOD * edit.anew.mse;
                rows.push(vec![
                    format!("{} % {}", 100.0 * edit.share, if edit.taken { "taken away" } else { "added" }),
                    format!("{:.2e}", edit.as_it_was),
                    format!("{:.2e}", edit.anew.mse),
                    format!("{:.1}", edit.anew.seconds),
                    match drawn {
                        SamplePlacement::Everywhere => "everywhere".into(),
                        SamplePlacement::NearTheChange => "half near the change".into(),
                    },
                    format!("{:.2e}", last.mse),
                    format!("{}{}", if met { "" } else { "more than " }, last.steps),
                    format!("{:.1}", last.seconds),
                    format!("{:.2}", last.seconds / edit.anew.seconds),
                ]);
            }
        }
        document.table(&head, rows);
        document
    }
}
