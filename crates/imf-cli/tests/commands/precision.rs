//! `--set precision=bf16`: as good as f32, recorded, resumed to the same bits; refused by name where it cannot be.

use imf_fields::recipe::Precision;
use imf_train::engine::CpuTrainer;

use crate::binary::{TRAIN, Workdir};

const STEPS: &str = "--steps 3000 --set schedule=cosine";

#[test]
fn a_training_in_bfloat16_is_as_good_and_resumes_to_the_same_bits() {
    let work = Workdir::with_dataset();
    let rounded = format!("{TRAIN} {STEPS} --set precision=bf16");
    if CpuTrainer::check_precision(Precision::Bf16).is_err() {
        work.imf(&format!("{rounded} --out none")).refused(&["bfloat16", "AVX-512 BF16", "f32"]);
        assert!(!work.path("none/checkpoint.safetensors").exists());
        return;
    }
    let whole = work.imf(&format!("{rounded} --out whole")).done();
    whole.warns(&["products in bfloat16"]);
    work.imf(&format!("{TRAIN} {STEPS} --out plain")).done();
    let [whole, plain] = ["whole", "plain"].map(|folder| work.model(&format!("{folder}/field.safetensors")));
    assert_eq!((whole.record.plan.precision, plain.record.plan.precision), (Precision::Bf16, Precision::F32));
    assert!(whole.state != plain.state, "nothing was rounded");
    let [of_whole, of_plain] = [&whole, &plain].map(|model| model.record.losses.last().unwrap().loss);
    // Both come down from 0.3 or so; chance alone parts two trainings of 3,000 steps by some percent.
    assert!(of_plain < 0.1 && of_whole < 1.25 * of_plain, "{of_whole} and {of_plain}");

    // What goes on keeps the precision of its checkpoint, whatever is asked for.
    let checkpoint = "broken/checkpoint.safetensors";
    work.interrupted_after(5, &format!("{rounded} --out broken --set checkpoint_every=0.02")).interrupted(&[
        "is saved in",
        checkpoint,
        "--resume",
    ]);
    assert!((1..3000).contains(&work.model(checkpoint).record.steps));
    work.imf(&format!("{TRAIN} {STEPS} --out broken --resume")).done();
    let broken = work.model("broken/field.safetensors");
    assert!(broken.state == whole.state, "the pieces ended elsewhere");
    assert_eq!(broken.record.plan, whole.record.plan);
}
