//! Toolpaths as comma-separated numbers: `x,y,z,i,j,k`, or `x,y,z` for a tool along +z.
//!
//! A first line of names may put the columns in any order; others are ignored. Lines that begin with `#` and empty
//! lines are skipped. Semicolons separate as well.

use super::{Location, Toolpath, Wrong, location};

const NAMES: [&str; 6] = ["x", "y", "z", "i", "j", "k"];

pub(super) fn parse(text: &str) -> Result<Toolpath, Wrong> {
    let mut columns: Option<Vec<usize>> = None;
    let mut locations: Vec<Location> = Vec::new();
    for (index, text) in text.lines().enumerate() {
        let line = index + 1;
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let fields: Vec<&str> = text.split([',', ';']).map(str::trim).collect();
        if columns.is_none() {
            columns = names(&fields, line)?;
            if columns.is_some() {
                continue;
            }
            columns = match fields.len() {
                3 => Some(vec![0, 1, 2]),
                6 => Some(vec![0, 1, 2, 3, 4, 5]),
                n => {
                    let what =
                        format!("{n} numbers; without a line of names there must be x,y,z or x,y,z,i,j,k");
                    return Err(Wrong { line, what });
                }
            };
        }
        let chosen = columns.as_deref().unwrap_or_default();
        let mut values = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        for (place, &column) in chosen.iter().enumerate() {
            let name = NAMES[place];
            let field = fields.get(column).ok_or_else(|| Wrong {
                line,
                what: format!("no column {name}: only {} fields", fields.len()),
            })?;
            values[place] = field
                .parse()
                .map_err(|_| Wrong { line, what: format!("{name} is '{field}', not a number") })?;
        }
        let [x, y, z, i, j, k] = values;
        locations.push(location(line, [x, y, z], [i, j, k])?);
    }
    Ok(Toolpath { locations, unknown: Vec::new() })
}

/// Columns of the names x, y, z and, if there are any, i, j, k; `None` for a line of numbers.
fn names(fields: &[&str], line: usize) -> Result<Option<Vec<usize>>, Wrong> {
    if fields.iter().all(|f| f.parse::<f64>().is_ok()) {
        return Ok(None);
    }
    let place = |name: &str| fields.iter().position(|f| f.eq_ignore_ascii_case(name));
    let found: Vec<Option<usize>> = NAMES.iter().map(|name| place(name)).collect();
    let whole = |range: std::ops::Range<usize>| found[range].iter().copied().collect::<Option<Vec<_>>>();
    match (whole(0..6), whole(0..3), found[3..].iter().any(Option::is_some)) {
        (Some(all), _, _) => Ok(Some(all)),
        (None, Some(position), false) => Ok(Some(position)),
        _ => Err(Wrong {
            line,
            what: "the line of names must have x,y,z,i,j,k, or x,y,z for a tool along +z".into(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn columns_go_by_name_or_by_place() {
        let path = parse("# made by hand\nk;j;i;feed;z;y;x\n2;0;0;900;3;2;1\n").ok().unwrap();
        assert_eq!(
            path.locations,
            [Location { line: 3, position: DVec3::new(1.0, 2.0, 3.0), axis: DVec3::Z }]
        );
        let path = parse("1,2,3,0,4,0\n\n 4 , 5 , 6 , 1 , 0 , 0 \n").ok().unwrap();
        assert_eq!(path.locations[0].axis, DVec3::Y);
        assert_eq!((path.locations[1].line, path.locations[1].axis), (3, DVec3::X));
        assert_eq!(parse("1,2,3\n").ok().unwrap().locations[0].axis, DVec3::Z);
    }

    #[test]
    fn mistakes_name_their_line() {
        let cases = [
            ("x,y,z,i,j,k\n1,2,3,0,0,1\n1,2,oops,0,0,1\n", 3, "z is 'oops'"),
            ("1,2,3,0,0,1\n1,2,3,0,0\n", 2, "no column k"),
            ("1,2,3,0,0,0\n", 1, "zero"),
            ("1,2,nan\n", 1, "finite"),
            ("1,2\n", 1, "2 numbers"),
            ("x,y,z,i\n", 1, "line of names"),
        ];
        for (text, line, what) in cases {
            let Err(wrong) = parse(text) else { panic!("{text}") };
            assert_eq!(wrong.line, line, "{text}");
            assert!(wrong.what.contains(what), "{text}: {}", wrong.what);
        }
    }
}
