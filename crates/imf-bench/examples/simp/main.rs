//! The bracket of the reference parts by topology optimisation: made once, its surface stored beside the module that reads it.
//!
//! ```text
//! cargo run --release -p imf-bench --example simp -- crates/imf-core/src/parts/bracket.obj [coarser]
//! ```
//!
//! Compliance under three pulls of the pin falls while 15 % of the design domain are left (`optimiser`, `bracket`). The
//! domain's symmetry leaves a quarter, on 24×72×88 elements of about a millimetre (486,000 displacements); most steps are taken
//! on half that resolution, the last from there on the full one. `coarser` of 2 gives a rougher part sooner. No random
//! numbers: the same machine makes the same file.

mod bracket;
mod element;
mod lattice;
mod optimiser;
mod solver;
mod stiffness;
mod surface;

use std::error::Error;
use std::time::Instant;

use optimiser::{Progress, optimise};

use imf_core::mesh::topology::MeshReport;
use imf_core::mesh::write::write_obj;
use imf_core::unit::LengthUnit;

/// Steps at each penalty on half the resolution: an even start finds the paths of the forces, then densities in between
/// become dear.
const COARSE: [(usize, f64); 4] = [(12, 1.0), (10, 1.5), (10, 2.0), (40, 3.0)];
/// Steps from there on the full one.
const FINE: [(usize, f64); 1] = [(12, 3.0)];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: simp FILE.obj [coarser]")?;
    let coarser: usize = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let begun = Instant::now();
    let report = |step: Progress| {
        println!(
            "step {:3}  penalty {:.1}  compliance {:10.4}  volume {:.4}  {} iterations  {:.0} s",
            step.step,
            step.penalty,
            step.compliance,
            step.volume,
            step.iterations,
            begun.elapsed().as_secs_f64()
        );
    };
    let half = bracket::problem(2 * coarser);
    let problem = bracket::problem(coarser);
    let found = optimise(&half, &COARSE, None, report)?;
    let start = problem.lattice.cut(&found.design);
    let design = optimise(&problem, &FINE, Some(&start), report)?;
    println!(
        "{:.2} of the domain's material; compliance {:.2} times the solid domain's; {:.0} s",
        bracket::VOLUME,
        design.compliance / design.solid_compliance,
        begun.elapsed().as_secs_f64()
    );
    let mesh = surface::surface(problem.lattice, &design.density)?;
    println!("{}", MeshReport::new(&mesh).display(LengthUnit::Mm));
    let comment = format!(
        "The bracket: topology optimisation by imf-bench's example simp, millimetres.\n{:.2} of the design domain, compliance \
         {:.2} times the solid domain's.",
        bracket::VOLUME,
        design.compliance / design.solid_compliance
    );
    Ok(write_obj(&mesh, path, &comment)?)
}
