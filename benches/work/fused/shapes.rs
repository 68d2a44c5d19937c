//! The three shapes of a pass, as C.

use super::list::Kind;
use super::printer::{INPUTS, INPUTS_L, LANES, NO_COST, Printer};
use std::fmt::Write;

impl Printer {
    pub fn fused(&self) -> String {
        let kind = Kind::Single;
        let mut out = String::from("static void run(const double *x, double *row) {\n");
        for i in 0..self.states {
            let _ = writeln!(out, "double x{i} = x[{i}], xt{i}, ax{i};");
        }
        out += &self.begin();
        out += "for (int t = 0; t < N; t++, row += NY * L) {\n";
        out += INPUTS;
        for n in 1..=4 {
            let (list, x, s, u) = match n {
                1 => (&self.point, "x", "s", "ua"),
                2 | 3 => (&self.stage, "xt", "st", "um"),
                _ => (&self.stage, "xt", "st", "ub"),
            };
            let (text, names) = list.body(kind, "t", x, u);
            let entry = |register: u32, _: usize| names[&register].clone();
            let value = |k: usize| list.value(&names, kind, k, x, u);
            let _ = writeln!(out, "{{ // stage {n}\n{text}{}", self.rates_of(list, s, &entry));
            if n == 1 {
                out += &self.rows_of(list, self.states, &entry);
                for j in 0..self.outputs {
                    let _ = writeln!(out, "row[{}] = {};", j * LANES, value(self.states + j));
                }
                out += "if (t + 1 == N) break;\n";
            }
            let r: Vec<String> = (0..self.states).map(value).collect();
            let _ = writeln!(out, "{}{}}}", self.led_states(n, kind, &r), self.led(n));
        }
        out += "}}\n";
        out += "static void rows(const double *p, const double *x0, int nd, double *row) { prepare(p); run(x0, row); }\n";
        out + NO_COST
    }

    pub fn segments(&self) -> String {
        let kind = Kind::Lanes;
        let ne = self.point.size()[1].max(self.stage.size()[1]);
        let ns = self.states;
        let mut out = format!(
            "#ifndef CHUNK\n#define CHUNK 8\n#endif\n#define NE {ne}\n\
             static double entries[CHUNK * 4 * NE * LW] __attribute__((aligned(64))), values[CHUNK * NY * LW] __attribute__((aligned(64)));\n\
             static void run(const double *x, int ns, double *rows) {{\n\
             double at[{ns}][LW] __attribute__((aligned(64)));\n\
             for (int g = 0; g < LW; g++) for (int i = 0; i < {ns}; i++) at[i][g] = x[{ns} * (g < ns ? g : ns - 1) + i];\n\
             V kept[LW][{ns}][{}];\n",
            LANES / self.w
        );
        for i in 0..ns {
            let _ = writeln!(out, "T x{i} = *(T*)at[{i}], xt{i}, ax{i};");
        }
        out += &format!(
            "{{ {} for (int g = 0; g < ns; g++) {{ {} }} }}\n",
            self.begin(),
            self.each(|i, v| format!("kept[g][{i}][{v}] = s{i}_{v};"))
        );
        out +=
            "for (int t0 = 0; t0 < N; t0 += CHUNK) {\nint t1 = t0 + CHUNK < N ? t0 + CHUNK : N;\n";
        out += "for (int t = t0; t < t1; t++) {\n";
        out += INPUTS_L;
        out += "double *e = entries + (t - t0) * 4 * NE * LW, *y = values + (t - t0) * NY * LW;\n";
        for n in 1..=4 {
            let (list, x, u) = match n {
                1 => (&self.point, "x", "ua"),
                2 | 3 => (&self.stage, "xt", "um"),
                _ => (&self.stage, "xt", "ub"),
            };
            let (text, names) = list.body(kind, "t", x, u);
            let value = |k: usize| list.value(&names, kind, k, x, u);
            let _ = writeln!(
                out,
                "{{ // stage {n}\n{text}{}",
                list.store(&names, &format!("e + {} * NE * LW", n - 1))
            );
            if n == 1 {
                for j in 0..self.outputs {
                    let _ = writeln!(out, "*(T*)(y + {j} * LW) = {};", value(ns + j));
                }
                out += "if (t + 1 == N) break;\n";
            }
            let r: Vec<String> = (0..ns).map(value).collect();
            let _ = writeln!(out, "{}}}", self.led_states(n, kind, &r));
        }
        out += "}\n";
        out += "#define E(t, n) (entries + (((t) - t0) * 4 + (n)) * NE * LW + g)\n#define O(t) E(t, 0)\n#define Y(t) (values + ((t) - t0) * NY * LW + g)\n";
        out +=
            "for (int g = 0; g < ns; g++) {\ndouble *row = rows + ((size_t)g * N + t0) * NY * L;\n";
        out +=
            &self.each(|i, v| format!("V s{i}_{v} = kept[g][{i}][{v}], st{i}_{v}, as{i}_{v};\n"));
        out += &self.sweep(&self.point, &self.point, ns);
        out += &self.each(|i, v| format!("kept[g][{i}][{v}] = s{i}_{v};\n"));
        out += "}}}\n";
        out += "static void rows(const double *p, const double *x0, int nd, double *row) { prepare(p);\n\
                if (nd == NP) return run(x0, 1, row);\n\
                static int calls; if (calls++ % NSEG) return;\n\
                for (int g = 0; g < NSEG; g += LW) run(x0 + 4 * g, g + LW < NSEG ? LW : NSEG - g, row + (size_t)g * N * NY * L); }\n";
        out + NO_COST
    }

    pub fn passes(&self) -> String {
        let (ne, no, ns) = (self.stage.size()[1], self.outs.size()[1], self.states);
        let mut out = format!(
            "#ifndef CHUNK\n#define CHUNK 32\n#endif\n#define NE {ne}\n#define NO {no}\n#define AL __attribute__((aligned(64)))\n\
             static double entries[CHUNK * 4 * NE] AL, outs[CHUNK * NO] AL, values[CHUNK * NY] AL, xs[{ns}][CHUNK * 4] AL, us[2][CHUNK * 4] AL, xp[{ns}][CHUNK] AL, up[2][CHUNK] AL;\n\
             static void run(const double *x, double *row) {{\n"
        );
        for i in 0..ns {
            let _ = writeln!(out, "double x{i} = x[{i}], xt{i}, ax{i};");
        }
        out += &self.begin();
        out +=
            "for (int t0 = 0; t0 < N; t0 += CHUNK) {\nint t1 = t0 + CHUNK < N ? t0 + CHUNK : N;\n";
        out += "for (int t = t0; t < t1; t++) {\n";
        out += INPUTS;
        out += "int d = t - t0, c = 4 * d;\nup[0][d] = ua0; up[1][d] = ua1;\n";
        for i in 0..ns {
            let _ = writeln!(out, "xp[{i}][d] = x{i};");
        }
        out += "if (t + 1 == N) break;\n";
        for n in 1..=4 {
            let (x, u) = [("x", "ua"), ("xt", "um"), ("xt", "um"), ("xt", "ub")][n - 1];
            let (text, names) = self.rates.body(Kind::Single, "t", x, u);
            let r: Vec<String> =
                (0..ns).map(|k| self.rates.value(&names, Kind::Single, k, x, u)).collect();
            let _ = writeln!(out, "{{ us[0][c + {}] = {u}0; us[1][c + {}] = {u}1;", n - 1, n - 1);
            for i in 0..ns {
                let _ = writeln!(out, "xs[{i}][c + {}] = {x}{i};", n - 1);
            }
            let _ = writeln!(out, "{text}{}}}", self.led_states(n, Kind::Single, &r));
        }
        out += "}\n";
        let load = |to: &str, x: &str, u: &str| -> String {
            let states: String =
                (0..ns).map(|i| format!("const T {to}{i} = *(T*)({x}[{i}] + b);\n")).collect();
            states + &format!("const T u0 = *(T*)({u}[0] + b), u1 = *(T*)({u}[1] + b);\n")
        };
        let (text, names) = self.stage.body(Kind::Lanes, "t", "q", "u");
        let _ = writeln!(
            out,
            "for (int b = 0; b < 4 * (t1 - t0); b += LW) {{\n{}{text}{}}}",
            load("q", "xs", "us"),
            self.stage.store(&names, "entries + b * NE")
        );
        let (text, names) = self.outs.body(Kind::Lanes, "t", "q", "u");
        let _ = writeln!(
            out,
            "for (int b = 0; b < t1 - t0; b += LW) {{\n{}{text}{}",
            load("q", "xp", "up"),
            self.outs.store(&names, "outs + b * NO")
        );
        for j in 0..self.outputs {
            let _ = writeln!(
                out,
                "*(T*)(values + b * NY + {j} * LW) = {};",
                self.outs.value(&names, Kind::Lanes, j, "q", "u")
            );
        }
        out += "}\n";
        out += "#define AT(list, n, k) (list + ((k) & ~(LW - 1)) * n + ((k) & (LW - 1)))\n#define E(t, n) AT(entries, NE, 4 * ((t) - t0) + (n))\n#define O(t) AT(outs, NO, (t) - t0)\n#define Y(t) AT(values, NY, (t) - t0)\n";
        out += &self.sweep(&self.stage, &self.outs, 0);
        out += "}}\n";
        out += "static void rows(const double *p, const double *x0, int nd, double *row) { prepare(p); run(x0, row); }\n";
        out + NO_COST
    }
}
