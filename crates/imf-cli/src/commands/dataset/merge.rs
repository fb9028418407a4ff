//! `imf dataset merge`: shares made apart become one dataset, or what is missing is named.

use anyhow::{Result, bail};
use imf_train::dataset::{Manifest, MergeSummary, merge};
use serde_json::json;

use super::interruption;
use crate::arguments::dataset::DatasetMergeArguments;
use crate::interrupt;
use crate::output::print_result;
use crate::session::Session;

/// Orientations that a line lists at most.
const LISTED: usize = 6;

pub(super) fn run(session: &Session, arguments: &DatasetMergeArguments) -> Result<()> {
    let out = &arguments.out;
    let _keeping = interrupt::stop_cleanly();
    let stage = session.stage("joining", "shards", 0);
    let advance = |n| stage.advance(n);
    let merged = merge(out, &arguments.folders, session.control(&advance));
    let merged = merged.map_err(|error| interruption(error, out))?;
    stage.finish(&format!("{} copied, {} there already", merged.copied, merged.kept));
    for damage in &merged.damaged {
        session.warn(&format!("left out: {damage}"));
    }
    let MergeSummary { manifest, kept, copied, missing, .. } = &merged;
    let samples: u64 = manifest.shards.iter().flatten().map(|shard| shard.samples).sum();
    let absent = |&shard: &usize| {
        let sections = manifest.sections_of(shard);
        let orientations = sections.iter().map(|&section| manifest.orientations.orientations[section]);
        json!({
            "shard": shard, "sections": sections,
            "orientations": orientations.map(|o| [o.theta, o.phi]).collect::<Vec<_>>(),
        })
    };
    let json = json!({
        "folder": out, "shards": manifest.shard_count(), "shards_copied": copied, "shards_kept": kept,
        "samples": samples, "damaged": merged.damaged,
        "missing": missing.iter().map(absent).collect::<Vec<_>>(),
    });
    let list: String = missing.iter().map(|&shard| missing_line(manifest, shard)).collect();
    let all = manifest.shard_count();
    let there = all - missing.len();
    let text = format!("{}: {samples} samples, {there} of {all} shards\n{list}", out.display());
    print_result(session, &json, &text)?;
    if missing.is_empty() {
        return Ok(());
    }
    bail!(
        "{} of {} shards are missing: `imf dataset finish {out}` makes them here; or merge {out} again with the folders \
         that hold them",
        missing.len(),
        all,
        out = out.display()
    )
}

fn missing_line(manifest: &Manifest, shard: usize) -> String {
    let sections = manifest.sections_of(shard);
    let listed = sections.iter().take(LISTED);
    let orientations = listed.clone().map(|&section| manifest.orientations.orientations[section]);
    let numbers: Vec<String> = listed.map(|section| (section + 1).to_string()).collect();
    let shown: Vec<String> = orientations.map(|o| format!("{:.3},{:.3}", o.theta, o.phi)).collect();
    let more = if sections.len() > LISTED { "; …" } else { "" };
    format!(
        "missing: shard {shard}, {} of {} orientations: number {}{more} (θ,φ: {}{more})\n",
        sections.len(),
        manifest.orientations.len(),
        numbers.join(", "),
        shown.join(";")
    )
}
