//! A crib of tools decided together, beside the same tools one by one.

use anyhow::Result;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::surface::{SurfaceTool, crib_access, surface_access};
use imf_core::tool::Tool;
use serde::Serialize;

use super::{End, ShopArguments, Surface, clearance, drawn, mill, table};
use crate::document::Document;
use crate::measurement::seconds;

#[derive(Serialize)]
pub(super) struct Row {
    scene: String,
    tools: usize,
    cutters: usize,
    seconds: f64,
    alone: usize,
    /// One tool from every direction, as it is found for a tool that is not in a crib, in the mean.
    one_seconds: f64,
    /// One tool in a crib by itself, for which one direction is enough, in the mean.
    one_in_a_crib_seconds: f64,
    /// Verdicts of a tool alone that are others together.
    different: usize,
}

impl Row {
    pub(super) fn new(session: &Session, surface: &Surface, arguments: &ShopArguments) -> Result<Self> {
        session.note("the crib");
        let (cutters, tools) = crib(arguments.tools as usize);
        let make = |tool: &Tool| -> Result<SurfaceTool> {
            Ok(SurfaceTool::new(&surface.surroundings, &tool.offset(&clearance())?, surface.tolerance)?)
        };
        let (samples, directions) = (&surface.samples, &surface.directions);
        let together = |tools: &[Tool]| {
            let tools = tools.iter().map(make).collect::<Result<Vec<_>>>()?;
            Ok(surface.pool.install(|| crib_access(&tools, samples, directions, Control::quiet()))?)
        };
        let (all_seconds, all) = seconds(|| together(&tools))?;
        let chosen: Vec<usize> = drawn((0..tools.len()).collect(), arguments.alone as usize);
        let (alone_seconds, different) = seconds(|| {
            let mut different = 0;
            for &index in &chosen {
                let tool = make(&tools[index])?;
                let find = || surface_access(&tool, samples, directions, Control::quiet());
                let access = surface.pool.install(find)?;
                let verdicts = access.reach.iter().zip(&all[index]);
                different += verdicts.filter(|(reach, verdict)| reach.verdict() != **verdict).count();
            }
            Ok(different)
        })?;
        let (one_by_one_seconds, ()) =
            seconds(|| chosen.iter().try_for_each(|&index| together(&tools[index..=index]).map(drop)))?;
        Ok(Self {
            scene: surface.name.clone(),
            tools: tools.len(),
            cutters,
            seconds: all_seconds,
            alone: chosen.len(),
            one_seconds: alone_seconds / chosen.len() as f64,
            one_in_a_crib_seconds: one_by_one_seconds / chosen.len() as f64,
            different,
        })
    }

    pub(super) fn write(&self, document: &mut Document) {
        let Self { tools, cutters, alone, one_seconds, one_in_a_crib_seconds, different, .. } = self;
        document.section("Crib");
        document.paragraph(self.scene.clone());
        table(
            document,
            &[
                ("tools, of so many cutters", format!("{tools}, {cutters}")),
                ("all together", format!("{:.2} s", self.seconds)),
                ("one from every direction, in the mean", format!("{one_seconds:.3} s of {alone}")),
                ("together, in times of that", format!("{:.1}", self.seconds / one_seconds)),
                ("one in a crib by itself, in the mean", format!("{one_in_a_crib_seconds:.3} s")),
                ("verdicts that differ", different.to_string()),
            ],
        );
    }
}

/// `count` tools, and the number of their cutters: ten diameters, three ends and two lengths of the flutes, each in
/// holders of six diameters at several stick-outs.
fn crib(count: usize) -> (usize, Vec<Tool>) {
    let diameters = [4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0];
    let ends = [End::Ball, End::Flat, End::Bull];
    let cutters: Vec<(End, f64, f64)> = diameters
        .into_iter()
        .flat_map(|diameter| ends.into_iter().map(move |end| (end, 0.5 * diameter)))
        .flat_map(|(end, radius)| [5.0, 8.0].map(|length| (end, radius, length * radius)))
        .collect();
    let tools: Vec<Tool> = (0..count)
        .map(|index| {
            let (end, radius, flutes) = cutters[index % cutters.len()];
            let set = index / cutters.len();
            let (holder, step) = (radius + 4.0 + 3.0 * (set % 6) as f64, set / 6);
            mill(end, radius, flutes, flutes + 5.0 + 12.0 * step as f64, [holder, 40.0])
        })
        .collect();
    (cutters.len().min(count), tools)
}
