//! What stands beside the paper's network: the nearest of the stored sections, linear interpolation between them, the
//! harmonic field fitted to as many, and the factored field that is distilled from that one.

use anyhow::Result;
use imf_cli::commands::train::harmonic::fit_field;
use imf_cli::engine::Device;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionPlan, ToolPoints};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use serde::{Deserialize, Serialize};

use super::Bench;
use crate::candidates::{distilled, harmonic_settings, symmetric};
use crate::interpolation::SectionTable;
use crate::measurement::seconds;
use crate::recipe::{Answer, EvaluationSets, Recipe};

/// A field beside the paper's network, and its results.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Method {
    pub(super) name: String,
    /// Seconds to make it.
    pub(super) made: f64,
    /// Seconds for the sections of the first IMF's set.
    pub(super) sections: f64,
    /// Bytes of what is saved.
    pub(super) bytes: u64,
    pub(super) answers: Vec<Answer>,
}

/// Computes the section of one orientation.
type Section<'a> = &'a dyn Fn(&Orientation, &mut [f32]);

/// Makes and evaluates all of them from the n × n sections of `grid:n`, or as many.
pub(super) fn measure(bench: &Bench<'_>, recipe: &Recipe, n: usize) -> Result<Vec<Method>> {
    let (session, evaluation_sets) = (bench.session, EvaluationSets::of(recipe)?);
    let (scene, distillation) = (bench.scene(&recipe.scene)?, bench.protocol.distillation());
    let voxels = scene.record.grid.len();
    let settings = harmonic_settings(n * n);
    let stored_bytes = SectionTable::memory(n, voxels);
    let tool = scene.record.tool.with_tip_only();
    let needed = stored_bytes
        + settings.memory(Domain::Directions, voxels).0
        // The factored field's coefficients at every voxel.
        + 2 * (voxels * settings.components) as u64
        + SectionPlan::memory_estimate(&scene.record.grid, &tool, session.threads());
    session.require_memory(needed, || format!("{} stored sections and a harmonic field of them", n * n))?;
    let plan = SectionPlan::of_scene(&scene, ToolPoints::Tip)?;

    let [exact_sections, asked] = evaluation_sets.sections();
    let (exact, (stored_in, stored)) =
        session.staged("exact sections", "sections", (n * n + exact_sections) as u64, |control| {
            let exact = evaluation_sets.exact(&plan, control)?;
            anyhow::Ok((exact, seconds(|| SectionTable::new(&plan, n, control))?))
        })?;
    let (domain, smaller) = (Domain::Directions, "take a smaller --scale");
    let (fitted_in, file) = seconds(|| fit_field(session, &scene, &plan, domain, settings, smaller))?;
    let harmonic = &file.field;
    let (distilled_in, factored) = seconds(|| {
        let settings = symmetric(&file, distillation);
        Ok(distilled(session, &Device::Cpu, &file, settings)?.field)
    })?;
    // Its coefficients at every voxel, once for all sections.
    let (expanded_in, expanded) =
        seconds(|| Ok(factored.evaluator().expanded(StoragePrecision::F16, harmonic.report)))?;

    let names = [
        "nearest section".into(),
        "linear in angle".into(),
        format!("harmonic, degree {}", settings.degree),
        format!("factored, {}×{}", distillation.hidden, distillation.width),
    ];
    let made = [stored_in, stored_in, fitted_in, fitted_in + distilled_in];
    let bytes = [stored_bytes, stored_bytes, harmonic.bytes(), factored.bytes()];
    let sections: [Section<'_>; 4] = [
        &|o, values| stored.nearest(o, values),
        &|o, values| stored.linear(o, values),
        &|o, values| harmonic.sections(&harmonic.direction_weights(&[*o]), values),
        &|o, values| expanded.sections(&expanded.direction_weights(&[*o]), values),
    ];
    let repeated = &evaluation_sets.imf[0].orientations;
    let stage = session.stage("baselines", "sections", (4 * (asked + repeated.len())) as u64);
    let advance = |sections| stage.advance(sections);
    let mut methods = Vec::new();
    for (index, (name, field)) in names.into_iter().zip(sections).enumerate() {
        let answers = evaluation_sets.ask(&plan, &exact, session.control(&advance), field)?;
        let mut values = vec![0.0; voxels];
        let (mut sections, ()) = seconds(|| {
            repeated.iter().for_each(|orientation| field(orientation, &mut values));
            Ok(())
        })?;
        advance(repeated.len() as u64);
        if index == 3 {
            sections += expanded_in;
        }
        methods.push(Method { name, made: made[index], sections, bytes: bytes[index], answers });
    }
    stage.finish("");
    Ok(methods)
}
