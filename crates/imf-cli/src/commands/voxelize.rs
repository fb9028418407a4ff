//! `imf voxelize`: the solid voxels of a part, as arrays, for ParaView, and as pictures.

use anyhow::Result;
use glam::DVec3;
use imf_core::field_files::{NamedField, write_npy, write_vti};
use serde_json::json;

use crate::arguments::VoxelizeArguments;
use crate::exit::WrongArgument;
use crate::output::{OutputFolder, SUMMARY, aligned, print_written, short, show_measure};
use crate::session::Session;
use crate::slices::{MidPlaneSheet, MidPlanes};

pub(crate) fn run(session: &Session, arguments: &VoxelizeArguments) -> Result<()> {
    let of_tools = [
        (!arguments.scene.clearance.clearance().is_zero(), "--clearance"),
        (arguments.scene.allow_coarse, "--allow-coarse"),
    ];
    if let Some((_, option)) = of_tools.iter().find(|(is_given, _)| *is_given) {
        let why = format!("{option} is of a tool: voxels are those of part and fixtures alone");
        return Err(WrongArgument(why).into());
    }
    let folder = OutputFolder::check(&arguments.out)?;
    let (bodies, mesh, unit, part) = arguments.scene.voxels(session)?;
    let obstacle = bodies.obstacle();
    let grid = obstacle.grid;
    let solid = &obstacle.solid[..];

    let volume = obstacle.volume();
    let guarantee =
        if arguments.scene.conservative { "every voxel that the surface touches" } else { "voxel centres" };
    let mut json = json!({
        "part": part,
        "unit": unit,
        "grid": grid,
        "conservative": arguments.scene.conservative,
        "solid_voxels": obstacle.count(),
        "volume": volume,
        "part_voxels": bodies.part.count(),
        "mesh": mesh,
        "undecided_fraction": bodies.undecided,
    });
    let files = ["slices.png", "solid.npy", "solid.vti", SUMMARY];
    let mut write = || -> Result<()> {
        folder.begin(session)?;
        let values: Vec<f32> = obstacle.solid.iter().map(|&s| f32::from(s)).collect();
        let sheet = MidPlaneSheet {
            title: format!("{part}: solid voxels"),
            label: "solid",
            part: &obstacle,
            style: None,
            unit,
            free: false,
            notes: vec![],
        };
        let [png, npy, vti] = ["slices.png", "solid.npy", "solid.vti"].map(|name| folder.file(name));
        sheet.save(&[MidPlanes::new(String::new(), &values, &grid)], &png)?;
        write_npy(&npy, grid.dims, solid)?;
        write_vti(&vti, &grid, &[NamedField::new("solid", solid)])?;
        folder.write_summary_of(&mut json, &files)
    };
    let written = write();
    let [x, y, z] = grid.dims;
    let surface = if mesh.closed {
        // Of enough voxels, which differ from the mesh by less.
        let own = bodies.part.volume();
        let differs = !arguments.scene.conservative
            && bodies.part.count() > 1000
            && (mesh.signed_volume.abs() / own - 1.0).abs() > 0.2;
        let added = match (mesh.components > 1, differs) {
            (true, _) => ", of all components added up",
            (false, true) => {
                " by the sides that its faces show, not the voxels': it is hardly thicker than a voxel, crosses itself, or some of it faces inwards"
            }
            (false, false) => "",
        };
        format!("closed, volume {} {unit}³{added}", show_measure(mesh.signed_volume.abs()))
    } else {
        format!(
            "open, {} boundary edges; its volume is not defined; inside is undecided at {:.1} % of the centres in or near it",
            mesh.boundary_edges,
            100.0 * bodies.undecided
        )
    };
    let fixtures = obstacle.count() - bodies.part.count();
    let of = match fixtures {
        0 => String::new(),
        count => format!(", {count} voxels of it of fixtures"),
    };
    let share = 100.0 * obstacle.count() as f64 / grid.len() as f64;
    let corner = |p: DVec3| p.to_array().map(short).join(", ");
    let mut lines = vec![
        ("part", part.clone()),
        ("grid", format!("{x}×{y}×{z}, pitch {} {unit}", short(grid.pitch))),
        ("from", format!("{} {unit}", corner(grid.origin))),
        ("to", format!("{} {unit}", corner(grid.origin + grid.size()))),
        (
            "solid",
            format!(
                "{} voxels ({share:.1} %), volume {} {unit}³{of}",
                obstacle.count(),
                show_measure(volume)
            ),
        ),
        ("solid where", guarantee.into()),
        ("mesh", surface),
    ];
    if written.is_ok() {
        lines.push(("written to", format!("{}: {}", folder.path.display(), files.join(", "))));
    }
    print_written(session, &json, &aligned(&lines), written)
}
