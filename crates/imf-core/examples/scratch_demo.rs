use imf_core::training::run::*;
use imf_core::training::schedule::Schedule;
use imf_core::training::*;
use imf_core::*;
use std::ops::ControlFlow;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (set, width, hidden, lr, batch, secs, density, omega): (
        String,
        usize,
        usize,
        f32,
        usize,
        f64,
        f64,
        f32,
    ) = (
        a[1].clone(),
        a[2].parse().unwrap(),
        a[3].parse().unwrap(),
        a[4].parse().unwrap(),
        a[5].parse().unwrap(),
        a[6].parse().unwrap(),
        a[7].parse().unwrap(),
        a[8].parse().unwrap(),
    );
    let steps: u64 = a[9].parse().unwrap();
    let mesh = parts::ReferencePart::Teapot.mesh();
    let tool = tool::Tool::paper();
    let spec = scene::SceneSpec {
        part: "teapot",
        mesh: &mesh,
        unit: unit::LengthUnit::Mm,
        transform: glam::DMat4::IDENTITY,
        resolution: scene::Resolution::Dims([29, 38, 61]),
        margin: 0,
        conservative: false,
        tool: &tool,
        fixtures: &[],
        around: scene::Around::Part,
    };
    let t = std::time::Instant::now();
    let scene = spec.scene().unwrap();
    eprintln!("voxels {:?} solid {}", t.elapsed(), scene.obstacle.count());
    let t = std::time::Instant::now();
    let set = orientation::OrientationSet::parse(&set).unwrap();
    let dir = tempfile::tempdir().unwrap();
    dataset::generate(
        dir.path(),
        &scene,
        &set,
        &dataset::Sampling { density, ..Default::default() },
        control::Control::quiet(),
    )
    .unwrap();
    let (_, scene, samples) = dataset::load(dir.path()).unwrap();
    eprintln!("dataset {:?} {}", t.elapsed(), samples.len());
    let shape = siren::SirenShape { width, hidden, omega, ..Default::default() };
    let plan = TrainingPlan {
        length: Length::Steps(steps),
        batch,
        schedule: Schedule::Cosine { initial: lr, last: lr * 0.01, warmup: 200 },
        adam: AdamConfig { weight_decay: 0.0, ..Default::default() },
        report_every: 2000,
        ..Default::default()
    };
    let state = TrainingState::new(&shape, 0);
    let mut engine = siren::engine::CpuTrainer::new(shape, plan.adam, plan.loss, batch, state).unwrap();
    let sp = section::SectionPlan::new(&scene.obstacle, &scene.record.tool).unwrap();
    let test = orientation::OrientationSet::parse("random:64:99").unwrap();
    let t = std::time::Instant::now();
    let near = evaluation::nearest_sections(
        &sp,
        &test.orientations,
        &set.orientations,
        0.01,
        control::Control::quiet(),
    )
    .unwrap()
    .overall;
    eprintln!("nearest mse {:e} var {:e} in {:?}", near.mse, near.variance, t.elapsed());
    let t = std::time::Instant::now();
    let mut next = 20.0;
    let mut first = true;
    train(&plan, &samples, &mut engine, Cursor::default(), &mut |r, e| {
        let el = t.elapsed().as_secs_f64();
        if first || el > next || r.step == r.total_steps {
            first = false; next = el + 30.0;
            let mut ev = siren::engine::CpuEvaluator::new(shape, &e.state().unwrap().parameters).unwrap();
            let r2 = evaluation::learnt_sections(&sp, &test.orientations[..16], &mut ev, 0.01, control::Control::quiet()).unwrap().overall;
            eprintln!("{:.0}s step {}/{} loss {:.2e} rate {:.0} mse {:.3e} mae {:.2e} mpe {:.3} ff {:.3} fb {:.3} iou {:.3}", el, r.step, r.total_steps, r.mean_loss, r.samples_per_second, r2.mse, r2.mae, r2.mpe, r2.false_free, r2.false_blocked, r2.iou);
        }
        if el > secs { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }).unwrap();
}
