//! Tables built, written and read back; what of them is refused, and in which words.

use super::*;

fn segments(flight: &str, ids: &[&str], included: Vec<bool>) -> Table {
    let n = ids.len();
    let reasons = included.iter().map(|i| (!i).then_some("gust"));
    Table::build("segments")
        .repeat("flight", flight)
        .strings("segment", ids)
        .repeat("kind", "3211")
        .repeat("input", "servo")
        .f64("t_start_s", (0..n).map(|i| 10.0 * i as f64).collect::<Vec<_>>())
        .f64("t_end_s", (0..n).map(|i| 10.0 * i as f64 + 9.0).collect::<Vec<_>>())
        .f64("unit_time_s", vec![f64::NAN; n])
        .f64("amplitude", vec![0.1; n])
        .i64("polarity", vec![-1; n])
        .f64("score", vec![0.9; n])
        .opt_strings("reason", reasons)
        .bools("included", included.clone())
        .finish()
        .unwrap()
}

fn samples(n: usize) -> Table {
    let t: Vec<f64> = (0..n).map(|i| i as f64 * 0.02).collect();
    let alpha = t.iter().map(|t| libm::sin(*t)).collect::<Vec<_>>();
    Table::build("samples")
        .repeat("flight", "f1")
        .f64("t_s", t)
        .dynamic("alpha", "rad", "Angle of attack.", alpha)
        .finish()
        .unwrap()
}

#[test]
fn a_table_is_checked_when_built_and_says_everything_that_is_wrong() {
    let e = Table::build("conditions")
        .strings("segment", ["a", "b"])
        .f64("signal", vec![1.0, 2.0])
        .strings("unit", ["rad"])
        .f64("value", vec![1.0, f64::NAN])
        .f64("valeu", vec![1.0, 2.0])
        .strings("unit", ["rad", "m"])
        .finish()
        .unwrap_err();
    assert_eq!(
        e.to_string(),
        "table \"conditions\": column \"valeu\" is not of this table; column \"unit\" is given twice; column \"flight\" is missing; \
         column \"signal\" must be string, not f64; column \"unit\" has 1 rows, the others 2"
    );
    let e = Table::build("bands").f64("x", vec![0.0, f64::NAN]).finish().unwrap_err().to_string();
    assert!(e.contains("column \"x\" has no value in row 1, and must have one"), "{e}");
    assert!(Table::build("bandz").finish().is_err());
}

#[test]
fn columns_are_read_by_name_and_type() {
    let t = segments("f1", &["a", "b"], vec![true, false]);
    assert_eq!((t.rows(), t.name()), (2, "segments"));
    assert_eq!(t.f64("t_start_s").unwrap(), [0.0, 10.0]);
    assert_eq!(t.i64("polarity").unwrap(), [-1, -1]);
    assert_eq!(t.bools("included").unwrap(), [true, false]);
    assert_eq!(t.strings("flight").unwrap(), ["f1", "f1"]);
    assert_eq!(t.opt_strings("reason").unwrap(), [None, Some("gust")]);
    assert_eq!(t.strings("reason").unwrap(), ["", "gust"]);
    assert!(t.f64("unit_time_s").unwrap().iter().all(|v| v.is_nan()));
    let e = t.f64("t_strat_s").unwrap_err().to_string();
    assert!(
        e.starts_with(
            "table \"segments\" has no column \"t_strat_s\"\n    did you mean \"t_start_s\"?"
        ),
        "{e}"
    );
    assert_eq!(
        t.f64("kind").unwrap_err().to_string(),
        "column \"kind\" of table \"segments\" is string, not f64"
    );
}

#[test]
fn missing_whole_numbers_stay_missing() {
    let table = Table::build("residuals")
        .repeat("model", "m")
        .repeat("group", "g")
        .opt_strings("segment", [None::<&str>, Some("s")])
        .repeat("output", "y")
        .repeat("unit", "rad")
        .i64("n", vec![3, 4])
        .f64("mean", vec![0.0, 1.0])
        .f64("sd", vec![1.0, f64::NAN])
        .f64("rms", vec![1.0, f64::NAN])
        .f64("theil", vec![0.1, 0.2])
        .f64("white_p", vec![0.5, f64::NAN])
        .f64("outside", vec![0.05, f64::NAN])
        .opt_i64("ar_order", vec![None, Some(2)])
        .f64("colour", vec![f64::NAN, 2.0])
        .finish()
        .unwrap();
    let back = Table::from_parquet("residuals", table.to_parquet().unwrap(), None).unwrap();
    assert_eq!(back.opt_i64("ar_order").unwrap(), [None, Some(2)]);
    assert_eq!(back.opt_strings("segment").unwrap(), [None, Some("s")]);
    assert!(back.f64("sd").unwrap()[1].is_nan() && back.f64("colour").unwrap()[0].is_nan());
    assert_eq!(back.f64("colour").unwrap()[1], 2.0);
    assert!(back.i64("ar_order").unwrap_err().to_string().contains("1 rows without a value"));
}

#[test]
fn rows_are_put_together_chosen_and_sorted() {
    let a = segments("f1", &["a2", "a1"], vec![true, false]);
    let b = segments("f2", &["b1"], vec![true]);
    let both = Table::concat("segments", &[a.clone(), b]).unwrap();
    assert_eq!(both.strings("segment").unwrap(), ["a2", "a1", "b1"]);
    let sorted = both.sorted(&["included", "segment"]).unwrap();
    assert_eq!(sorted.strings("segment").unwrap(), ["a1", "a2", "b1"]);
    assert_eq!(
        both.sorted(&["t_start_s", "flight"]).unwrap().strings("segment").unwrap(),
        ["a2", "b1", "a1"]
    );
    assert_eq!(both.filter(|i| i != 0).unwrap().strings("segment").unwrap(), ["a1", "b1"]);
    assert!(both.take(&[3]).is_err());
    assert!(Table::concat("segments", &[a, samples(2)]).is_err());
    assert_eq!(Table::concat::<Table>("segments", &[]).unwrap().rows(), 0);
}

#[test]
fn dynamic_columns_keep_unit_and_meaning_and_are_nan_where_a_flight_lacks_them() {
    let other = Table::build("samples").repeat("flight", "f2").f64("t_s", vec![0.0]).dynamic(
        "V",
        "m/s",
        "Airspeed.",
        vec![90.0],
    );
    let other = other.finish().unwrap();
    let back =
        Table::from_parquet("samples", samples(3).to_parquet().unwrap(), Some("f1")).unwrap();
    assert_eq!(back.column("alpha").unwrap().unit, "rad");
    assert_eq!(back.column("alpha").unwrap().doc, "Angle of attack.");
    let both = Table::concat("samples", &[back, other]).unwrap();
    assert_eq!(both.rows(), 4);
    assert!(
        both.f64("V").unwrap()[..3].iter().all(|v| v.is_nan())
            && both.f64("alpha").unwrap()[3].is_nan()
    );
    let feet = Table::build("samples")
        .repeat("flight", "f3")
        .f64("t_s", vec![0.0])
        .dynamic("alpha", "-", "", vec![1.0])
        .finish()
        .unwrap();
    let e = Table::concat("samples", &[samples(1), feet]).unwrap_err().to_string();
    assert!(e.starts_with("column \"alpha\" of \"samples\" is in rad and in -"), "{e}");
    let e =
        Table::build("bands").dynamic("y", "m", "", vec![1.0]).finish().unwrap_err().to_string();
    assert!(e.contains("column \"y\" is not of this table"), "{e}");
}

#[test]
fn columns_that_differ_by_case_only_are_refused() {
    let build =
        |name: &str| {
            let table = Table::build("samples")
                .repeat("flight", "f1")
                .f64("t_s", vec![0.0])
                .dynamic("V", "m/s", "Airspeed.", vec![90.0]);
            table.dynamic(name, "m/s", "Lateral velocity.", vec![0.0]).finish()
        };
    assert!(build("v_body").is_ok());
    assert_eq!(
        build("v").unwrap_err().to_string(),
        "table \"samples\": columns \"V\" and \"v\" differ by case only"
    );
    assert!(
        build("T_s")
            .unwrap_err()
            .to_string()
            .contains("columns \"t_s\" and \"T_s\" differ by case only")
    );
    // Each of two flights is fine by itself, both together are not.
    let one = |name: &str| {
        Table::build("samples")
            .repeat("flight", "f1")
            .f64("t_s", vec![0.0])
            .dynamic(name, "m/s", "", vec![1.0])
            .finish()
            .unwrap()
    };
    let e = Table::concat("samples", &[one("tas"), one("TAS")]).unwrap_err().to_string();
    assert!(
        e.contains("\"tas\" and \"TAS\" differ by case only") && e.contains("another name"),
        "{e}"
    );
}

/// The IEEE total order, which later versions of the crate write for numbers, makes polars before 2
/// refuse a file.
#[test]
fn every_column_has_the_order_of_its_type_in_the_footer() {
    use ::parquet::basic::ColumnOrder;
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    let tables = schemas().iter().map(|s| Table::empty(&s.name).unwrap());
    let full = [samples(100), segments("f1", &["a", "b"], vec![true, false])];
    let mut kinds = std::collections::BTreeSet::new();
    for table in tables.chain(full) {
        let reader =
            SerializedFileReader::new(bytes::Bytes::from(table.to_parquet().unwrap())).unwrap();
        let file = reader.metadata().file_metadata();
        let orders =
            file.column_orders().unwrap_or_else(|| panic!("{} has no column orders", table.name()));
        assert_eq!(orders.len(), file.schema_descr().num_columns());
        for (column, order) in file.schema_descr().columns().iter().zip(orders) {
            assert!(
                matches!(order, ColumnOrder::TYPE_DEFINED_ORDER(_)),
                "{} {}: {order:?}",
                table.name(),
                column.name()
            );
            kinds.insert(column.physical_type().to_string());
        }
    }
    assert_eq!(kinds.len(), 4, "numbers, whole numbers, truth values and texts: {kinds:?}");
}

#[test]
fn the_same_table_gives_the_same_bytes_and_comes_back() {
    let table = samples(5000);
    let bytes = table.to_parquet().unwrap();
    assert_eq!(bytes, samples(5000).to_parquet().unwrap());
    assert_eq!(Table::from_parquet("samples", bytes.clone(), Some("f1")).unwrap(), table);
    let again = Table::from_parquet("samples", bytes.clone(), Some("f1")).unwrap();
    assert_eq!(again.to_parquet().unwrap(), bytes);
    // 5000 grid times and sines in 16 bytes a row raw.
    assert!(bytes.len() < 5000 * 16, "{} bytes", bytes.len());
}

#[test]
fn files_carry_units_meanings_and_the_encodings_meant() {
    use ::parquet::basic::{Compression, Encoding};
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    let bytes = segments("f1", &["a", "b"], vec![true, true]).to_parquet().unwrap();
    let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
    let file = reader.metadata().file_metadata();
    assert_eq!(file.created_by(), Some(concat!("koehler ", env!("CARGO_PKG_VERSION"))));
    let pairs = file.key_value_metadata().unwrap();
    let value = |key: &str| pairs.iter().find(|p| p.key == key).and_then(|p| p.value.clone());
    assert_eq!(value("table"), Some("segments".into()));
    assert_eq!(value("schema_version"), Some(SCHEMA_VERSION.to_string()));
    assert_eq!(value("unit.t_start_s"), Some("s".into()));
    assert_eq!(
        value("doc.t_start_s"),
        Some("Start of the first step; of a sweep, when it leaves trim.".into())
    );
    let group = reader.metadata().row_group(0);
    assert!(
        group.columns().iter().all(|c| c.column_path().string() != "flight"),
        "the flight stands in the path"
    );
    for column in group.columns() {
        assert!(matches!(column.compression(), Compression::ZSTD(_)));
        let used: Vec<Encoding> = column.encodings().collect();
        match column.column_path().string().as_str() {
            "t_start_s" => assert!(used.contains(&Encoding::PLAIN), "{used:?}"),
            "polarity" => assert!(used.contains(&Encoding::DELTA_BINARY_PACKED), "{used:?}"),
            "kind" => assert!(used.contains(&Encoding::RLE_DICTIONARY), "{used:?}"),
            _ => {}
        }
    }
}

#[test]
fn a_dataset_is_written_and_read_flight_by_flight() {
    let dir = tempfile::tempdir().unwrap();
    for (flight, id) in [("f2", "b"), ("f10", "c"), ("f1", "a")] {
        let path =
            write_part(dir.path(), &segments(flight, &[id], vec![true]), Some(flight), 0).unwrap();
        assert!(path.ends_with(format!("segments/flight={flight}/part-0.parquet")));
    }
    let all = read_dataset(dir.path(), "segments").unwrap();
    assert_eq!(all.strings("flight").unwrap(), ["f1", "f10", "f2"]);
    assert_eq!(all.strings("segment").unwrap(), ["a", "c", "b"]);
    assert_eq!(
        read_part(dir.path(), "segments", Some("f2"), 0).unwrap(),
        segments("f2", &["b"], vec![true])
    );
    assert_eq!(read_dataset(dir.path(), "fits").unwrap().rows(), 0);
    assert_eq!(parts(dir.path(), "segments").unwrap().len(), 3);
    let e = read_part(dir.path(), "segments", Some("f3"), 0).unwrap_err().to_string();
    assert!(e.contains("flight=f3/part-0.parquet: cannot read the file"), "{e}");
}

#[test]
fn parts_are_in_the_order_of_their_numbers() {
    let dir = tempfile::tempdir().unwrap();
    for part in [10, 2, 0] {
        write_part(dir.path(), &Table::empty("estimates").unwrap(), None, part).unwrap();
    }
    let numbers: Vec<usize> =
        parts(dir.path(), "estimates").unwrap().into_iter().map(|p| p.number).collect();
    assert_eq!(numbers, [0, 2, 10]);
}

#[test]
fn what_flights_have_of_a_part_stands_behind_its_number() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = Table::empty("estimates").unwrap().to_parquet().unwrap();
    for name in ["part-1", "part-0-f2", "part-10-f-1", "part-0-f-1", "part-0"] {
        write_atomic(&dir.path().join(format!("estimates/{name}.parquet")), &bytes).unwrap();
    }
    let found = parts(dir.path(), "estimates").unwrap();
    let paths: Vec<String> = found.iter().map(|p| p.path("estimates").unwrap()).collect();
    let wanted = ["part-0", "part-0-f-1", "part-0-f2", "part-1", "part-10-f-1"];
    assert_eq!(paths, wanted.map(|name| format!("estimates/{name}.parquet")));
    assert_eq!(read_dataset(dir.path(), "estimates").unwrap().rows(), 0);
}

#[test]
fn a_wrong_part_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let table = segments("f1", &["a"], vec![true]);
    assert!(write_part(dir.path(), &table, None, 0).is_err());
    assert!(write_part(dir.path(), &table, Some("../f1"), 0).is_err());
    assert!(write_part(dir.path(), &Table::empty("fits").unwrap(), Some("f1"), 0).is_err());
    let e = write_part(dir.path(), &table, Some("f2"), 0).unwrap_err().to_string();
    assert_eq!(e, "table \"segments\" of flight f2 has a row of flight \"f1\"");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn a_file_is_replaced_whole_and_nothing_else_is_left() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a/b.txt");
    write_atomic(&path, b"one").unwrap();
    write_atomic(&path, b"two").unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"two");
    assert_eq!(std::fs::read_dir(dir.path().join("a")).unwrap().count(), 1);
    // A folder stands where the file should go: the write fails and leaves nothing behind.
    std::fs::create_dir_all(dir.path().join("c/taken/inside")).unwrap();
    let e = write_atomic(&dir.path().join("c/taken"), b"x").unwrap_err().to_string();
    assert!(e.contains("taken: cannot write the file"), "{e}");
    assert_eq!(std::fs::read_dir(dir.path().join("c")).unwrap().count(), 1);
}

#[test]
fn a_broken_or_foreign_file_is_refused_with_its_path() {
    let dir = tempfile::tempdir().unwrap();
    let path = write_part(dir.path(), &segments("f1", &["a"], vec![true]), Some("f1"), 0).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for broken in [&bytes[..bytes.len() / 2], &[], b"PAR1"] {
        std::fs::write(&path, broken).unwrap();
        let e = read_dataset(dir.path(), "segments").unwrap_err().to_string();
        assert!(
            e.contains("part-0.parquet: this is no readable file of the table \"segments\""),
            "{e}"
        );
    }
    let e = Table::from_parquet("conditions", bytes.clone(), Some("f1")).unwrap_err().to_string();
    assert!(e.contains("it lacks the column \"signal\""), "{e}");
    assert!(
        Table::from_parquet("segments", bytes, None)
            .unwrap_err()
            .to_string()
            .contains("which flight")
    );
    let fits = Table::empty("fits").unwrap().to_parquet().unwrap();
    assert!(Table::from_parquet("points", fits, None).is_err());
}

#[test]
fn empty_tables_of_every_schema_come_back() {
    for schema in schemas() {
        let table = Table::empty(&schema.name).unwrap();
        let flight = schema.per_flight.then_some("f1");
        let back = Table::from_parquet(&schema.name, table.to_parquet().unwrap(), flight).unwrap();
        assert_eq!(back, table, "{}", schema.name);
    }
}

mod campaign_level {
    use super::super::campaign::{Line, counts, points};
    use super::*;

    fn estimates(rows: &[(&str, Option<&str>, f64, f64, &str)]) -> Table {
        Table::build("estimates")
            .repeat("model", "m")
            .strings("group", rows.iter().map(|r| r.0))
            .opt_strings("flight", rows.iter().map(|_| None::<&str>))
            .opt_strings("segment", rows.iter().map(|r| r.1))
            .repeat("parameter", "C")
            .repeat("per", "segment")
            .opt_strings("of", rows.iter().map(|r| r.1))
            .repeat("unit", "1/rad")
            .f64("value", rows.iter().map(|r| r.2).collect::<Vec<_>>())
            .f64("sd", rows.iter().map(|r| r.3).collect::<Vec<_>>())
            .f64("sd_crlb", rows.iter().map(|r| r.3).collect::<Vec<_>>())
            .f64("sd_total", rows.iter().map(|r| r.3).collect::<Vec<_>>())
            .f64("lower", vec![f64::NAN; rows.len()])
            .f64("upper", vec![f64::NAN; rows.len()])
            .opt_strings("interval", rows.iter().map(|_| None::<&str>))
            .f64("start", vec![0.0; rows.len()])
            .bools("at_bound", vec![false; rows.len()])
            .strings("stop", rows.iter().map(|r| r.4))
            .finish()
            .unwrap()
    }

    fn conditions(flight: &str, rows: &[(&str, &str, f64)]) -> Table {
        Table::build("conditions")
            .repeat("flight", flight)
            .strings("segment", rows.iter().map(|r| r.0))
            .strings("signal", rows.iter().map(|r| r.1))
            .repeat("unit", "rad")
            .f64("value", rows.iter().map(|r| r.2).collect::<Vec<_>>())
            .finish()
            .unwrap()
    }

    const LINE: Line = Line { model: "m", parameter: "C", against: "alpha", fit: "m-alpha" };

    #[test]
    fn points_join_estimates_with_flight_and_condition_and_account_for_the_rest() {
        let segments = [
            segments("f2", &["f2-1", "f2-2", "f2-3"], vec![true, true, true]),
            segments("f1", &["f1-1", "f1-2", "f1-3"], vec![true, false, true]),
        ];
        let conditions = [
            conditions(
                "f2",
                &[
                    ("f2-1", "alpha", 0.1),
                    ("f2-1", "V", 90.0),
                    ("f2-2", "alpha", 0.2),
                    ("f2-3", "alpha", 0.3),
                ],
            ),
            conditions(
                "f1",
                &[("f1-1", "alpha", 0.4), ("f1-2", "alpha", 0.5), ("f1-3", "alpha", f64::NAN)],
            ),
        ];
        let estimates = [
            estimates(&[
                ("f2-2", None, 2.0, 0.2, "converged"),
                ("f2-1", Some("f2-1"), 1.0, 0.1, "converged"),
            ]),
            estimates(&[
                ("f1-1", None, 4.0, 0.4, "converged"),
                ("f1-2", None, 5.0, 0.5, "converged"),
                ("f1-3", None, 6.0, 0.6, "converged"),
                ("f2-3", None, f64::NAN, f64::NAN, "singular"),
                ("all", None, 9.0, 0.9, "converged"),
            ]),
        ];
        let found = points(&estimates, &segments, &conditions, LINE).unwrap();
        assert_eq!(found.table.strings("segment").unwrap(), ["f1-1", "f2-1", "f2-2"]);
        assert_eq!(found.table.strings("flight").unwrap(), ["f1", "f2", "f2"]);
        assert_eq!(found.table.f64("x").unwrap(), [0.4, 0.1, 0.2]);
        assert_eq!(found.table.f64("value").unwrap(), [4.0, 1.0, 2.0]);
        assert_eq!(found.table.f64("sd").unwrap(), [0.4, 0.1, 0.2]);
        assert_eq!(found.table.strings("unit_x").unwrap(), ["rad"; 3]);
        let left: Vec<(&str, &str)> =
            found.left_out.iter().map(|(s, w)| (s.as_str(), w.as_str())).collect();
        assert_eq!(
            left,
            [
                ("f1-2", "the segment is excluded: gust"),
                ("f1-3", "alpha has no value before the maneuver"),
                ("f2-3", "the estimate has no result: singular")
            ]
        );
        let other = Line { parameter: "D", ..LINE };
        assert_eq!(points(&estimates, &segments, &conditions, other).unwrap().table.rows(), 0);
    }

    #[test]
    fn two_estimates_of_one_segment_are_refused() {
        let estimates = [estimates(&[
            ("s", None, 1.0, 0.1, "converged"),
            ("all", Some("s"), 1.0, 0.1, "converged"),
        ])];
        let e = points(
            &estimates,
            &[segments("f", &["s"], vec![true])],
            &[conditions("f", &[("s", "alpha", 0.1)])],
            LINE,
        );
        assert!(
            e.unwrap_err()
                .to_string()
                .starts_with("segment s has two estimates of C: of the groups all and s")
        );
    }

    #[test]
    fn points_of_nothing_are_an_empty_table() {
        let found = points::<Table>(&[], &[], &[], LINE).unwrap();
        assert_eq!((found.table.rows(), found.left_out.len()), (0, 0));
    }

    #[test]
    fn rows_are_counted_by_columns() {
        let tables = [
            segments("f2", &["a", "b", "c"], vec![true, false, true]),
            segments("f1", &["d"], vec![true]),
        ];
        let text = |rows: Vec<(Vec<String>, usize)>| {
            rows.into_iter().map(|(k, n)| format!("{}: {n}", k.join(" "))).collect::<Vec<_>>()
        };
        assert_eq!(
            text(counts("segments", &tables, &["flight", "included"]).unwrap()),
            ["f1 true: 1", "f2 false: 1", "f2 true: 2"]
        );
        assert_eq!(
            text(counts("segments", &tables, &["kind", "polarity"]).unwrap()),
            ["3211 -1: 4"]
        );
        assert!(counts("segments", &tables, &["kynd"]).is_err());
        assert!(counts::<Table>("segments", &[], &["kind"]).unwrap().is_empty());
    }
}

#[test]
fn a_choice_of_columns_is_read_as_all_of_them_are() {
    let table = Table::build("samples")
        .repeat("flight", "one")
        .f64("t_s", vec![0.0, 0.1])
        .dynamic("V", "m/s", "airspeed", vec![80.0, f64::NAN])
        .dynamic("h", "m", "altitude", vec![1.0, 2.0])
        .finish()
        .expect("a table");
    let bytes = table.to_parquet().expect("bytes");
    let only = ["h".to_string(), "not there".to_string()];
    let want = Want { columns: Some(&only), ..Want::default() };
    let some =
        Table::part_of_parquet("samples", bytes::Bytes::from(bytes.clone()), Some("one"), want);
    let some = some.expect("two of its columns");
    let all = Table::from_parquet("samples", bytes, Some("one")).expect("all of them");
    assert!(all.has("V") && !some.has("V") && some.rows() == 2);
    assert_eq!(some.column("h").ok(), all.column("h").ok());
    assert_eq!(some.f64("h").ok(), all.f64("h").ok());
    assert_eq!(some.strings("flight").ok(), all.strings("flight").ok());
}

/// The bytes of a file with the columns of a table, whose arrow schema `change` makes another.
fn rewritten(
    table: &Table,
    change: impl Fn(&::arrow_schema::Field) -> ::arrow_schema::Field,
) -> Vec<u8> {
    let schema = super::schema::in_file(table.file_columns());
    let batch = table.in_file(&schema, 0..table.rows()).unwrap();
    let fields: Vec<_> = batch.schema().fields().iter().map(|f| change(f)).collect();
    let schema = Arc::new(::arrow_schema::Schema::new(fields));
    let batch = RecordBatch::try_new(schema.clone(), batch.columns().to_vec()).unwrap();
    let mut writer = ::parquet::arrow::ArrowWriter::try_new(Vec::new(), schema, None).unwrap();
    writer.write(&batch).unwrap();
    writer.into_inner().unwrap()
}

#[test]
fn a_file_without_a_version_is_read_where_its_columns_are_those_of_now() {
    let table = segments("f1", &["a"], vec![true]);
    let read = |bytes| Table::from_parquet("segments", bytes, Some("f1"));
    assert_eq!(read(rewritten(&table, Clone::clone)).unwrap(), table);
    let bare = |f: &::arrow_schema::Field| f.clone().with_metadata([].into());
    assert_eq!(read(rewritten(&table, bare)).unwrap(), table);
    let e = read(rewritten(&table, |f| match f.name().as_str() {
        "unit_time_s" => f.clone().with_metadata([("unit".into(), "min".into())].into()),
        _ => f.clone(),
    }));
    let e = e.unwrap_err().to_string();
    assert!(e.contains("its column \"unit_time_s\" is in min, not s"), "{e}");
    let e = read(rewritten(&table, |f| match f.name().as_str() {
        "unit_time_s" => f.clone().with_name("unit_time"),
        _ => f.clone(),
    }));
    let e = e.unwrap_err().to_string();
    assert!(e.contains("it lacks the column \"unit_time_s\""), "{e}");
}

#[test]
fn a_choice_of_rows_is_read_as_it_is_taken_from_all_of_them() {
    let names = ["a", "a", "b", "b", "b", "a", "c"];
    let table = Table::build("conditions")
        .strings("flight", ["one"; 7])
        .strings("segment", names)
        .repeat("signal", "V")
        .repeat("unit", "m/s")
        .f64("value", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
        .finish()
        .expect("a table");
    let bytes = table.to_parquet().expect("bytes");
    let read = |rows: Rows| {
        let want = Want { rows: Some(&rows), ..Want::default() };
        let read = Table::part_of_parquet(
            "conditions",
            bytes::Bytes::from(bytes.clone()),
            Some("one"),
            want,
        );
        read.expect("some of its rows").f64("value").expect("values").to_vec()
    };
    assert_eq!(read(Rows::Of("segment", std::sync::Arc::new(|s| s == "a"))), [0.0, 1.0, 5.0]);
    assert_eq!(read(Rows::Of("segment", std::sync::Arc::new(|_| false))), [0.0; 0]);
    assert_eq!(read(Rows::Ends("segment")), [0.0, 1.0, 2.0, 4.0, 5.0, 6.0]);
    assert_eq!(read(Rows::Ends("not there")).len(), 7);
}

#[test]
fn row_groups_without_a_wanted_text_are_left_alone() {
    // Some 400 000 rows, three row groups and a part of a fourth, 40 flights one behind the other.
    let rows = 400_000;
    let names: Vec<String> = (0..rows).map(|k| format!("f{:02}-{}", k / 10_000, k % 3)).collect();
    let table = Table::build("conditions")
        .strings("flight", vec!["one"; rows])
        .strings("segment", names.iter().map(String::as_str))
        .repeat("signal", "V")
        .repeat("unit", "m/s")
        .f64("value", (0..rows).map(|k| k as f64).collect::<Vec<_>>())
        .finish()
        .expect("a table");
    let bytes = bytes::Bytes::from(table.to_parquet().expect("bytes"));
    use ::parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
    let file = ParquetRecordBatchReaderBuilder::try_new(bytes.clone()).expect("a file");
    for (flight, groups) in
        [("f00", vec![0]), ("f13", vec![0, 1]), ("f20", vec![1]), ("f99", vec![])]
    {
        let is_mine = std::sync::Arc::new(move |s: &str| s.starts_with(flight));
        let reach = [flight.to_string(), format!("{flight}-{}", char::MAX)];
        let within = Rows::Within("segment", reach, is_mine.clone());
        assert_eq!(within.groups(file.metadata()), Some(groups), "{flight}");
        let read = |rows: &Rows| {
            let want = Want { rows: Some(rows), ..Want::default() };
            let read = Table::part_of_parquet("conditions", bytes.clone(), Some("one"), want);
            read.expect("some of its rows").f64("value").expect("values").to_vec()
        };
        assert_eq!(read(&within), read(&Rows::Of("segment", is_mine)), "{flight}");
    }
}
