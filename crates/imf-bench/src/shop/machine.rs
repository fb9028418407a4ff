//! A machine's poses a second: a five-axis path around the bracket on a trunnion, with spindle head and table, on one thread.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use glam::{DMat4, DVec3};
use imf_cli::session::Session;
use imf_core::check::{CheckBodies, CheckReport, CheckSettings, MachineBodies, check_toolpath};
use imf_core::control::Control;
use imf_core::machine::Machine;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::parts::ReferencePart;
use imf_core::tool::Tool;
use imf_core::toolpath::{PathReading, Toolpath};
use imf_core::unit::LengthUnit;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use super::{End, PITCH, ShopArguments, mill, table, voxels};
use crate::document::Document;
use crate::measurement::seconds;

/// How far above the part's box the path goes.
const ABOVE: f64 = 3.0;
/// Ways across the part, of `LINES` lines each; a longer path goes over it again.
const ROWS: usize = 20;
const LINES: usize = 100;

#[derive(Serialize)]
pub(super) struct Row {
    lines: usize,
    poses: u64,
    colliding_lines: usize,
    /// Of what is made for a path of one line: distances of all bodies.
    prepare_seconds: f64,
    seconds: f64,
    poses_per_second: f64,
}

/// What stands still, and who comes.
struct Work {
    pool: ThreadPool,
    part: Occupancy,
    mesh: Mesh,
    machine: MachineBodies,
    tool: Tool,
    bounds: (DVec3, DVec3),
}

impl Row {
    pub(super) fn new(session: &Session, arguments: &ShopArguments) -> Result<Self> {
        session.note("a machine's poses");
        let work = Work::new()?;
        let lines = arguments.lines as usize;
        let (one, all) = (work.path(1)?, work.path(lines)?);
        let (prepare_seconds, _) = seconds(|| work.check(&one))?;
        let (all_seconds, report) = seconds(|| work.check(&all))?;
        let seconds = (all_seconds - prepare_seconds).max(f64::MIN_POSITIVE);
        Ok(Self {
            lines,
            poses: report.poses,
            colliding_lines: report.colliding.len(),
            prepare_seconds,
            seconds,
            poses_per_second: report.poses as f64 / seconds,
        })
    }

    pub(super) fn write(&self, document: &mut Document) {
        document.section("A machine's poses");
        document.paragraph(format!(
            "The bracket in voxels of {PITCH} mm on the platter of a trunnion with five solids, a ball end mill of 10 mm in a holder of 40 mm, \
             five axes moving, one thread. A pose is one of the tool among part and table, and of the head among both."
        ));
        table(
            document,
            &[
                ("lines, poses", format!("{}, {}", self.lines, self.poses)),
                ("lines that collide", self.colliding_lines.to_string()),
                ("what is prepared for a first line", format!("{:.2} s", self.prepare_seconds)),
                ("all others", format!("{:.2} s", self.seconds)),
                ("poses a second", format!("{:.2} million", 1e-6 * self.poses_per_second)),
            ],
        );
    }
}

impl Work {
    fn new() -> Result<Self> {
        let mesh = ReferencePart::Bracket.mesh();
        let (lower, upper) = mesh.bounds().unwrap_or_default();
        // On the platter's middle.
        let middle = 0.5 * (lower + upper);
        let mesh = mesh.transformed(&DMat4::from_translation(DVec3::new(-middle.x, -middle.y, -lower.z)));
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/guide/machines/trunnion-ac.toml");
        Ok(Self {
            pool: ThreadPoolBuilder::new().num_threads(1).build()?,
            part: voxels(&mesh)?,
            machine: MachineBodies::new(Machine::read(&file)?, PITCH, Control::quiet())?,
            tool: mill(End::Ball, 5.0, 30.0, 60.0, [20.0, 40.0]),
            bounds: mesh.bounds().unwrap_or_default(),
            mesh,
        })
    }

    fn check(&self, path: &Toolpath) -> Result<CheckReport> {
        let bodies = CheckBodies {
            surfaces: &[&self.mesh],
            machine: Some(&self.machine),
            ..CheckBodies::of_part(&self.part)
        };
        let settings = CheckSettings::of_pitch(PITCH, LengthUnit::Mm);
        let check = || check_toolpath(bodies, &[(None, &self.tool)], path, &settings, Control::quiet());
        Ok(self.pool.install(check)?)
    }

    /// To and fro over the part, tilting as it goes.
    fn path(&self, lines: usize) -> Result<Toolpath> {
        let (lower, upper) = self.bounds;
        let mut text = String::from("x,y,z,A,C\n");
        for line in 0..lines {
            let (row, at) = (line / LINES % ROWS, line % LINES);
            let along = at as f64 / LINES as f64;
            let along = if row % 2 == 0 { along } else { 1.0 - along };
            let x = lower.x + (upper.x - lower.x) * along;
            let y = lower.y + (upper.y - lower.y) * row as f64 / ROWS as f64;
            let (a, c) = (-15.0 + 15.0 * (6.0 * along).sin(), 40.0 * along);
            // Writing to a string does not fail.
            let _ = writeln!(text, "{x:.4},{y:.4},{:.4},{a:.4},{c:.4}", upper.z + ABOVE);
        }
        let lengths = [(None, self.tool.length())];
        let machine = Some(self.machine.machine());
        let reading = PathReading { unit: LengthUnit::Mm, machine, lengths: &lengths };
        Ok(Toolpath::parse(&text, reading, "path")?)
    }
}
