//! Harmonic fields against exact sections: error at random directions, time to make and to evaluate, refining.
//!
//! `cargo run --release -p imf-bench --example harmonic -- [part] [degree] [axes] [sections a function] [scale]`

use std::error::Error;
use std::time::Instant;

use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, SectionPlan, imf, sections, stream_sections};
use imf_core::tool::Tool;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::{FitSettings, fit};
use imf_fields::metrics::Errors;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument =
        |index: usize, default: &str| arguments.get(index).map_or(default.to_owned(), Clone::clone);
    let part: ReferencePart = argument(0, "teapot").parse()?;
    let settings = FitSettings {
        degree: argument(1, "14").parse()?,
        axes: argument(2, "225").parse()?,
        sections_per_function: argument(3, "4").parse()?,
        precision: Precision::F16,
        ..FitSettings::default()
    };
    let scale: f64 = argument(4, "1").parse()?;
    let dims = part.dims().map(|n| (n as f64 * scale).round() as usize);
    let (mesh, tool) = (part.mesh(), Tool::paper());
    let scene = SceneSpec::of_reference(part, &mesh, dims, &tool).scene()?;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, At::SharpPoints)?;
    let voxels = plan.grid().len();
    let seconds = |start: Instant| start.elapsed().as_secs_f64();

    let random = OrientationSet::parse("random:256:77")?.orientations;
    let start = Instant::now();
    let exact = sections(&plan, &random, Control::quiet())?;
    println!("{}: {:?}, {:.2} ms a section", part.name(), dims, seconds(start) * 1e3 / 256.0);

    // By turns with as many sections as functions, so that other work on the machine disturbs both alike.
    let functions = settings.sizes(Domain::Directions).functions;
    let as_many = OrientationSet::parse(&format!("fibonacci:{functions}"))?.orientations;
    let (mut counted, mut made, mut kept) = (f64::INFINITY, f64::INFINITY, None);
    for _ in 0..3 {
        let start = Instant::now();
        stream_sections(&plan, &as_many, Control::quiet(), || (), |(), _, _| {})?;
        counted = counted.min(seconds(start));
        drop(kept.take());
        let start = Instant::now();
        kept = Some(fit(&plan, Domain::Directions, &settings, Control::quiet())?);
        made = made.min(seconds(start));
    }
    let field = kept.ok_or("no field")?;
    println!(
        "made in {made:.2} s, {:.2} times the {counted:.2} s of {functions} sections: {:?}, {:.0} MB",
        made / counted,
        field.report,
        field.bytes() as f64 / 1e6
    );

    let heads = field.direction_weights(&random);
    let mut values = vec![0.0; voxels * random.len()];
    field.sections(&heads, &mut values);
    let mut errors = Errors::default();
    for (exact, values) in exact.iter().zip(values.chunks_exact(voxels)) {
        errors.add(exact, values, 1e-3);
    }
    println!("256 random directions: {:?}", errors.report(1e-3));

    for (spec, exactly) in [("fibonacci:225", true), ("fibonacci:10000", false)] {
        let set = OrientationSet::parse(spec)?.orientations;
        if set.len() <= 256 {
            let start = Instant::now();
            let heads = field.direction_weights(&set);
            field.sections(&heads, &mut values[..voxels * set.len()]);
            println!("{spec}: sections in {:.3} s", seconds(start));
        }
        let start = Instant::now();
        let heads = field.direction_weights(&set);
        let prepared = seconds(start);
        let least = field.minimum(&heads);
        print!("{spec}: IMF in {:.3} s (directions {prepared:.3} s)", seconds(start));
        if exactly {
            let start = Instant::now();
            let exact = imf(&plan, &set, Control::quiet())?;
            let mut errors = Errors::default();
            errors.add(&exact.value, &least.value, 1e-3);
            print!("; exact in {:.3} s; {:?}", seconds(start), errors.report(1e-3));
        }
        println!();
    }
    drop(values);
    let set = OrientationSet::parse("fibonacci:225")?.orientations;
    let least = field.minimum(&field.direction_weights(&set));
    let start = Instant::now();
    if let Some(refined) = field.refined(&least, &set, Control::quiet())? {
        let gains = least.value.iter().zip(&refined.value).map(|(a, b)| f64::from(a - b));
        let lower = gains.clone().filter(|&gain| gain > 0.0).count();
        println!(
            "refined over the sphere in {:.2} s: lower at {lower} of {voxels} voxels, by {:.1e} in the mean of these",
            seconds(start),
            gains.sum::<f64>() / lower.max(1) as f64
        );
    }
    Ok(())
}
