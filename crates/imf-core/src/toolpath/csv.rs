//! Toolpaths as tables of numbers: a header that names every column, then a line for each location.
//!
//! Columns may stand in any order, separated by commas, semicolons, tabs or spaces, whichever the header has. Lines that
//! begin with `#` and empty lines are skipped. Every column must be known: one that is not might turn the tool. With a machine there
//! may be a column for each of its rotary axes, and the tip goes straight in the part's frame.

use super::error::Fault;
use super::{Direction, Location, MachinePoint, MoveKind, PathReading, Toolpath, pose};
use crate::file_error::unended_line;
use crate::machine::{Joints, Machine};

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Column {
    /// Tip: x, y, z by place.
    Position(usize),
    /// Axis from tip to holder: i, j, k by place.
    Axis(usize),
    /// θ, φ in degrees by place.
    Angle(usize),
    /// ψ in degrees.
    Roll,
    /// A rotary axis of the machine in degrees, by place.
    Rotary(usize),
    /// The tool's number.
    Tool,
    /// 1 where the tool comes at rapid rate, 0 at feed rate.
    Rapid,
    /// Nothing that moves or turns the tool.
    Still,
}

/// Every name that means something, in lower case, and what.
const NAMES: [(&str, Column); 13] = [
    ("x", Column::Position(0)),
    ("y", Column::Position(1)),
    ("z", Column::Position(2)),
    ("i", Column::Axis(0)),
    ("j", Column::Axis(1)),
    ("k", Column::Axis(2)),
    ("theta", Column::Angle(0)),
    ("phi", Column::Angle(1)),
    ("roll", Column::Roll),
    ("psi", Column::Roll),
    ("tool", Column::Tool),
    ("t", Column::Tool),
    ("rapid", Column::Rapid),
];

/// Names of columns that move and turn nothing.
const STILL: [&str; 13] = [
    "feed", "feedrate", "f", "speed", "spindle", "s", "comment", "remark", "name", "line", "n", "id", "time",
];

/// What a header must have, for messages.
const WANTED: &str = "x,y,z for a tool along +z, x,y,z,i,j,k (the axis from tip to holder) or x,y,z,theta,phi, each with roll where it counts";

/// The columns of a header.
struct Header {
    /// `None` for spaces.
    separator: Option<char>,
    columns: Vec<Column>,
    titles: Vec<String>,
}

pub(super) fn parse(text: &str, reading: &PathReading<'_>) -> Result<Toolpath, Fault> {
    let mut header: Option<Header> = None;
    let mut locations = Vec::new();
    for (index, text) in text.lines().enumerate() {
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let wrong = |what: String| Fault::from(what).on_line(index + 1);
        match &header {
            None => header = Some(Header::read(text, reading.machine).map_err(wrong)?),
            Some(header) => locations.push(header.location(index + 1, text, reading).map_err(wrong)?),
        }
    }
    let mut remarks = Vec::new();
    // Tables that are written by hand often lack the last line's end.
    if let Some((line, _)) = unended_line(text.as_bytes())
        && locations.last().is_some_and(|last: &Location| last.line == line)
    {
        remarks.push(format!(
            "line {line}: the file ends without an end of this line, which is taken to be whole"
        ));
    }
    let states_rapids = header.is_some_and(|header| header.columns.contains(&Column::Rapid));
    Ok(Toolpath { locations, remarks, states_rapids, ..Toolpath::default() })
}

impl Header {
    fn read(text: &str, machine: Option<&Machine>) -> Result<Self, String> {
        let separator = [';', '\t', ','].into_iter().find(|&separator| text.contains(separator));
        let titles: Vec<String> = fields(text, separator).into_iter().map(str::to_ascii_lowercase).collect();
        // Titles appear in messages, and a terminal obeys control characters.
        if text.contains(|letter: char| {
            letter.is_control() && letter != '\t' || letter == char::REPLACEMENT_CHARACTER
        }) {
            return Err(format!(
                "this is not text: a table of numbers is wanted, below a line with their columns, {WANTED}"
            ));
        }
        if titles.iter().any(|title| title.parse::<f64>().is_ok()) {
            return Err(format!(
                "numbers alone do not say what they are: name the columns in a line above, {WANTED}"
            ));
        }
        let columns = titles.iter().map(|title| column(title, machine)).collect::<Result<Vec<_>, _>>()?;
        let header = Self { separator, columns, titles };
        header.check()?;
        header.check_rotary(machine)?;
        Ok(header)
    }

    /// Each column once, positions and directions whole.
    fn check(&self) -> Result<(), String> {
        for (place, column) in self.columns.iter().enumerate() {
            if *column != Column::Still && self.columns[..place].contains(column) {
                return Err(format!("the column '{}' stands twice", self.titles[place]));
            }
        }
        let has = |column| self.place(column).is_some();
        let axes = (0..3).filter(|&i| has(Column::Axis(i))).count();
        let angles = (0..2).filter(|&i| has(Column::Angle(i))).count();
        let whole =
            (0..3).all(|i| has(Column::Position(i))) && matches!(axes, 0 | 3) && matches!(angles, 0 | 2);
        match (whole, axes > 0 && angles > 0) {
            (true, false) => Ok(()),
            (true, true) => {
                Err("the columns say the tool's direction twice, by i,j,k and by theta,phi".into())
            }
            (false, _) => Err(format!("the columns '{}' are not complete: {WANTED}", self.titles.join(","))),
        }
    }

    /// All of the machine's rotary axes, or none, and then no direction beside them.
    fn check_rotary(&self, machine: Option<&Machine>) -> Result<(), String> {
        let axes = machine.map_or(&[][..], |machine| machine.rotary.as_slice());
        let has = |column: Column| self.place(column).is_some();
        if !(0..axes.len()).any(|place| has(Column::Rotary(place))) {
            return Ok(());
        }
        if let Some(place) = (0..axes.len()).find(|&place| !has(Column::Rotary(place))) {
            return Err(format!(
                "the machine has an axis {} as well, and there is no column for it",
                axes[place].letter
            ));
        }
        if has(Column::Axis(0)) || has(Column::Angle(0)) || has(Column::Roll) {
            return Err("the rotary axes say how the tool is turned, and so do other columns (i,j,k, theta,phi or roll)".into());
        }
        Ok(())
    }

    fn place(&self, column: Column) -> Option<usize> {
        self.columns.iter().position(|&own| own == column)
    }

    fn location(&self, line: usize, text: &str, reading: &PathReading<'_>) -> Result<Location, String> {
        let fields = fields(text, self.separator);
        if fields.len() != self.titles.len() {
            return Err(format!("{} fields below a header of {}", fields.len(), self.titles.len()));
        }
        let number = |column: Column| -> Result<Option<f64>, String> {
            let Some(place) = self.place(column) else { return Ok(None) };
            let (field, title) = (fields[place], &self.titles[place]);
            let hint = if field.contains(',') { " (decimals have a point)" } else { "" };
            let value = field.parse::<f64>();
            value.map(Some).map_err(|_| format!("{title} is '{field}', not a number{hint}"))
        };
        let need = |column: Column| Ok::<_, String>(number(column)?.unwrap_or(0.0));
        let position = [need(Column::Position(0))?, need(Column::Position(1))?, need(Column::Position(2))?];
        let direction = if self.place(Column::Axis(0)).is_some() {
            Direction::Axis([need(Column::Axis(0))?, need(Column::Axis(1))?, need(Column::Axis(2))?])
        } else {
            // Upright where there is no direction at all.
            Direction::Angles([need(Column::Angle(0))?, need(Column::Angle(1))?])
        };
        let roll = number(Column::Roll)?;
        let tool = match self.place(Column::Tool).map(|place| fields[place]) {
            Some(field) => {
                Some(field.parse().map_err(|_| format!("tool is '{field}', not the number of a tool"))?)
            }
            None => None,
        };
        let kind = match self.place(Column::Rapid).map(|place| fields[place]) {
            None | Some("0") => MoveKind::Feed,
            Some("1") => MoveKind::Rapid,
            Some(field) => {
                return Err(format!("rapid is '{field}', neither 1 (at rapid rate) nor 0 (at feed rate)"));
            }
        };
        let pose = pose(position, direction, roll)?;
        let mut machine = None;
        if let Some(axes) = reading.machine.filter(|_| self.place(Column::Rotary(0)).is_some()) {
            let rotary = [need(Column::Rotary(0))?, need(Column::Rotary(1))?];
            if !rotary.iter().all(|angle| angle.is_finite()) {
                return Err("an angle must be finite".into());
            }
            let length = reading.known_length_of(tool)?;
            let joints = Joints { linear: axes.linear(pose.position, &rotary, length), rotary };
            machine = Some(MachinePoint { joints, length, tip_goes_straight: true, by_spindle: false });
        }
        Ok(Location { line, pose, rolled: roll.is_some(), tool, kind, machine })
    }
}

/// The fields of a line without the quotes that some programs put around them.
fn fields(text: &str, separator: Option<char>) -> Vec<&str> {
    fn bare(field: &str) -> &str {
        let field = field.trim();
        field.strip_prefix('"').and_then(|field| field.strip_suffix('"')).unwrap_or(field).trim()
    }
    match separator {
        Some(separator) => text.split(separator).map(bare).collect(),
        None => text.split_whitespace().map(bare).collect(),
    }
}

fn column(title: &str, machine: Option<&Machine>) -> Result<Column, String> {
    let letter = title.chars().next().filter(|_| title.len() == 1);
    if let Some(place) = letter.zip(machine).and_then(|(letter, machine)| machine.rotary_by_letter(letter)) {
        return Ok(Column::Rotary(place));
    }
    if let Some((_, column)) = NAMES.iter().find(|(name, _)| *name == title) {
        return Ok(*column);
    }
    if STILL.contains(&title) {
        return Ok(Column::Still);
    }
    if machine.is_some() && matches!(title, "a" | "b" | "c") {
        return Err(format!("the column '{title}' is an angle of a rotary axis that the machine has not"));
    }
    Err(column_remedy(title).unwrap_or_else(|| {
        format!(
            "the column '{title}' is not known and might move or turn the tool: leave it out, or name it by what it is: {WANTED}; \
             tool and rapid are read, feed, speed, comment and line are skipped"
        )
    }))
}

/// What is wrong with a column of poses that has this title, in lower case, and how to say it instead; `None` of others.
#[must_use]
pub fn column_remedy(title: &str) -> Option<String> {
    match title {
        "a" | "b" | "c" => Some(format!(
            "the column '{title}' is an angle of a rotary axis, which says nothing without its machine: where a machine can be \
             given, give it, or convert the axes to i,j,k, the direction from tip to holder"
        )),
        "nx" | "ny" | "nz" => Some(format!(
            "the column '{title}' may be a normal of the surface or the tool's axis: name the axis from tip to holder i,j,k"
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::tests::trunnion;
    use crate::orientation::Orientation;
    use crate::pose::Pose;
    use crate::toolpath::error::tests::assert_refused;
    use crate::unit::LengthUnit;
    use glam::DVec3;

    #[test]
    fn a_column_says_of_every_line_whether_it_is_rapid() {
        let states = |text: &str| parse(text, &LengthUnit::Mm.into()).unwrap().states_rapids;
        assert!(states("x,y,z,rapid\n0,0,0,0\n") && !states("x,y,z\n0,0,0\n"));
        let program = |text: &str| Toolpath::parse(text, LengthUnit::Mm, "path.nc").unwrap().states_rapids;
        assert!(program("G21 G90\nG0 X0. Y0. Z9.\n"));
        // Some write rapids as G1.
        assert!(!program("G21 G90\nG1 X0. Y0. Z9. F9000\n"));
    }

    fn read(text: &str) -> Vec<Location> {
        let path = parse(text, &LengthUnit::Mm.into()).map(|path| path.locations);
        path.unwrap_or_else(|wrong| panic!("{text}: {wrong:?}"))
    }

    #[test]
    fn columns_go_by_name_whatever_separates_them() {
        let table = "# made by hand\nk,j,i,feed,z,y,x\n.5,0,0,900,3,2,1\n\n 2 , 1 , 0 , 80 , 6 , 5 , 4 \n";
        for separator in [",", ";", "\t", "; "] {
            let path = read(&table.replace(',', separator));
            assert_eq!(path[0].pose, Pose::along(DVec3::new(1.0, 2.0, 3.0), DVec3::Z));
            assert_eq!((path[1].line, path[1].rolled), (5, false));
            assert_eq!(path[1].pose, Pose::along(DVec3::new(4.0, 5.0, 6.0), DVec3::new(0.0, 1.0, 2.0)));
        }
        let path = read("\"X\" \"Y\"  Z\n1 2 3\n");
        assert_eq!(path[0].pose, Pose::along(DVec3::new(1.0, 2.0, 3.0), DVec3::Z));
        assert_eq!(path[0].tool, None);
    }

    #[test]
    fn a_last_line_without_an_end_is_remarked() {
        let said = "line 2: the file ends without an end of this line, which is taken to be whole";
        for (text, remarks) in
            [("x,y,z\n0,0,6", vec![said]), ("x,y,z\n0,0,60\n", vec![]), ("x,y,z\n0,0,60\n#", vec![])]
        {
            assert_eq!(parse(text, &LengthUnit::Mm.into()).unwrap().remarks, remarks, "{text}");
        }
    }

    #[test]
    fn angles_rolls_and_tools_are_read() {
        let path = read("tool,x,y,z,theta,phi,roll\n7,1,2,3,372,6,-90\n8,1,2,3,30,0,0\n");
        let orientation = Orientation { roll: 270.0, ..Orientation::new(12.0, 6.0) };
        assert_eq!(path[0].pose, Pose::oriented(DVec3::new(1.0, 2.0, 3.0), &orientation));
        assert_eq!((path[0].rolled, path[0].tool, path[1].tool), (true, Some(7), Some(8)));
        // Upright, θ is a roll.
        assert_eq!(path[1].pose.rotation, Orientation::new(30.0, 0.0).quaternion());
        // A direction by its angles is that by its components.
        let phi = 0.1_f64.atan2(-0.995).to_degrees();
        let [angles, named] =
            [format!("x,y,z,theta,phi\n0,3,40,90,{phi}\n"), "x,y,z,i,j,k\n0,3,40,0,.1,-.995\n".into()]
                .map(|text| read(&text)[0].pose.axis().unwrap());
        assert!((angles - named).length() < 1e-12, "{angles} {named}");
        let path = read("x,y,z,i,j,k,roll\n1,2,3,0,0,1,45\n");
        assert_eq!(path[0].pose.rotation, Orientation { roll: 45.0, ..Orientation::default() }.quaternion());
    }

    #[test]
    fn a_column_says_which_lines_are_rapids() {
        let path = read("x,y,z,rapid\n0,0,9,1\n0,0,5,0\n0,0,9,1\n");
        let kinds: Vec<MoveKind> = path.iter().map(|location| location.kind).collect();
        assert_eq!(kinds, [MoveKind::Rapid, MoveKind::Feed, MoveKind::Rapid]);
    }

    #[test]
    fn what_is_not_understood_is_refused_with_its_line() {
        let cases = [
            ("x,y,z,i,j,k\n1,2,3,0,0,1\n1,2,oops,0,0,1\n", 3, "z is 'oops'"),
            ("x,y,z,i,j,k\n1,2,3,0,0,1\n1,2,3,0,0\n", 3, "5 fields below a header of 6"),
            ("x,y,z,i,j,k\n1,2,3,0,0,0\n", 2, "zero"),
            ("x,y,z\n1,2,nan\n", 2, "finite"),
            ("\n0,30,98,0,.1,-.995\n", 2, WANTED),
            ("\n0,30,98,0,.1,-.995\n", 2, "numbers alone do not say what they are: name the columns"),
            ("0;30;98\n", 1, "name the columns"),
            ("\u{1b}[2J,y,z\n1,2,3\n", 1, "not text"),
            ("x,y,z,i\n", 1, "not complete"),
            ("x,y,i,j,k\n", 1, "not complete"),
            ("x,y,z,A,C\n0,30,98,5,0\n", 1, "'a' is an angle of a rotary axis"),
            ("x,y,z,A,C\n0,30,98,5,0\n", 1, "convert the axes to i,j,k"),
            ("x,y,z,nx,ny,nz\n", 1, "'nx' may be a normal"),
            ("x,y,z,u,v,w\n", 1, "'u' is not known"),
            ("x,y,z,i,j,k,theta,phi\n", 1, "twice, by i,j,k and by theta,phi"),
            ("x,y,z,x\n", 1, "'x' stands twice"),
            ("x,y,z,theta,phi\n1,2,3,0,181\n", 2, "phi from 0 to 180"),
            ("x,y,z,theta,phi,roll\n1,2,3,0,0,inf\n", 2, "roll must be finite"),
            ("x;y;z\n1,5;2,0;3,0\n", 2, "decimals have a point"),
            ("x,y,z,tool\n1,2,3,ball\n", 2, "tool is 'ball'"),
            ("x,y,z,rapid\n1,2,3,yes\n", 2, "rapid is 'yes', neither 1"),
        ];
        for (text, line, what) in cases {
            assert_refused(parse(text, &LengthUnit::Mm.into()), line, what);
        }
        // A machine with the axes A and C.
        let machine = trunnion();
        let on = PathReading { machine: Some(&machine), ..LengthUnit::Mm.into() };
        for (text, what) in [
            ("x,y,z,B,C\n0,0,40,0,0\n", "'b' is an angle of a rotary axis that the machine has not"),
            ("x,y,z,A\n0,0,40,0\n", "axis C as well"),
        ] {
            assert_refused(parse(text, &on), 1, what);
        }
    }
}
