//! The paper's network learns by default at any width and ω.

use crate::binary::Workdir;

#[test]
fn every_width_and_frequency_learns_from_its_default_rate() {
    let work = Workdir::with_dataset();
    // Network, steps, and the loss that the last twenty of them must be below: a quarter above what they come to.
    let networks = [
        ("5x64:1", 400, 0.035),
        ("5x64", 400, 0.026),
        ("5x64:30", 400, 0.05),
        ("5x128", 400, 0.0165),
        ("5x256", 400, 0.013),
        ("5x512", 400, 0.0111),
        ("5x1024", 150, 0.036),
    ];
    let mut above = Vec::new();
    for (network, steps, most) in networks {
        let out = network.replace(':', "-");
        let line = format!("train siren5 data --device cpu --network {network} --steps {steps} --batch 256");
        work.imf(&format!("{line} --no-calibrate --out {out}")).done();
        let record = work.model(&format!("{out}/field.safetensors")).record;
        let loss = record.losses.last().unwrap().loss;
        println!("{network}: {loss:.2e} of {most:.2e} after {steps} steps");
        if loss >= most {
            above.push(network);
        }
    }
    assert!(above.is_empty(), "{above:?}");
}
