//! Expression text to a syntax tree, with the byte offset of every node for messages.

/// One node of an expression and where it begins in the text.
#[derive(Debug, Clone, PartialEq)]
pub struct Expr {
    pub at: usize,
    pub kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    Number(f64),
    Name(String),
    Negative(Box<Expr>),
    Binary(Operator, Box<Expr>, Box<Expr>),
    Call(String, Vec<Expr>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operator {
    Add,
    Sub,
    Mul,
    Div,
    Pow,
}

/// A syntax error: byte offset in the text and what is wrong.
pub type Syntax = (usize, String);

/// Deepest nesting accepted, so that a hostile file cannot exhaust the stack.
const DEPTH: usize = 200;

/// Most operations of one expression: a sum of many terms is a tree as deep as it is long, and all
/// that walks over it takes the stack for every term.
const OPERATIONS: usize = 1000;

/// Parses one expression. Precedence from low to high: `+ -`, `* /`, unary `-`, `^` (right to
/// left).
pub fn parse(text: &str) -> Result<Expr, Syntax> {
    let tokens = tokens(text)?;
    let mut parser = Parser { tokens: &tokens, at: 0, depth: 0, operations: 0 };
    let expr = parser.sum()?;
    match parser.peek() {
        Token::End => Ok(expr),
        other => Err((parser.offset(), format!("{} is not expected here", other.name()))),
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Symbol(char),
    End,
}

impl Token {
    fn name(&self) -> String {
        match self {
            Token::Number(x) => format!("the number {x}"),
            Token::Name(n) => format!("the name \"{n}\""),
            Token::Symbol(c) => format!("\"{c}\""),
            Token::End => "the end of the expression".into(),
        }
    }
}

fn tokens(text: &str) -> Result<Vec<(usize, Token)>, Syntax> {
    let mut out = Vec::new();
    let bytes = text.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let c = bytes[i];
        if c.is_ascii_whitespace() {
            i += 1;
        } else if c.is_ascii_alphabetic() || c == b'_' {
            let start = i;
            while i < bytes.len() && (bytes[i].is_ascii_alphanumeric() || bytes[i] == b'_') {
                i += 1;
            }
            out.push((start, Token::Name(text[start..i].to_string())));
        } else if c.is_ascii_digit() || c == b'.' {
            let start = i;
            i = number_end(bytes, i);
            let digits = &text[start..i];
            let value: f64 =
                digits.parse().map_err(|_| (start, format!("\"{digits}\" is not a number")))?;
            out.push((start, Token::Number(value)));
        } else if b"+-*/^(),".contains(&c) {
            out.push((i, Token::Symbol(c as char)));
            i += 1;
        } else {
            let c = text[i..].chars().next().unwrap_or('?');
            return Err((i, format!("the character \"{c}\" means nothing in an expression")));
        }
    }
    out.push((text.len(), Token::End));
    Ok(out)
}

fn number_end(bytes: &[u8], mut i: usize) -> usize {
    let digits = |i: &mut usize| {
        while *i < bytes.len() && bytes[*i].is_ascii_digit() {
            *i += 1;
        }
    };
    digits(&mut i);
    if bytes.get(i) == Some(&b'.') {
        i += 1;
        digits(&mut i);
    }
    if matches!(bytes.get(i), Some(b'e' | b'E')) {
        let mut j = i + 1;
        if matches!(bytes.get(j), Some(b'+' | b'-')) {
            j += 1;
        }
        if bytes.get(j).is_some_and(u8::is_ascii_digit) {
            digits(&mut j);
            i = j;
        }
    }
    i
}

struct Parser<'a> {
    tokens: &'a [(usize, Token)],
    at: usize,
    depth: usize,
    operations: usize,
}

impl Parser<'_> {
    fn peek(&self) -> &Token {
        &self.tokens[self.at].1
    }

    fn offset(&self) -> usize {
        self.tokens[self.at].0
    }

    fn advance(&mut self) {
        if self.at + 1 < self.tokens.len() {
            self.at += 1;
        }
    }

    fn accept(&mut self, c: char) -> bool {
        let found = *self.peek() == Token::Symbol(c);
        if found {
            self.advance();
        }
        found
    }

    fn deeper(&mut self) -> Result<(), Syntax> {
        self.depth += 1;
        if self.depth <= DEPTH {
            return Ok(());
        }
        Err((self.offset(), format!("the expression is nested deeper than {DEPTH} levels")))
    }

    /// Steps over an operator.
    fn operator(&mut self) -> Result<(), Syntax> {
        self.operations += 1;
        if self.operations > OPERATIONS {
            let why = format!(
                "the expression has more than {OPERATIONS} operations: give parts of it names of their own"
            );
            return Err((self.offset(), why));
        }
        self.advance();
        Ok(())
    }

    fn sum(&mut self) -> Result<Expr, Syntax> {
        self.deeper()?;
        let mut left = self.product()?;
        loop {
            let op = match self.peek() {
                Token::Symbol('+') => Operator::Add,
                Token::Symbol('-') => Operator::Sub,
                _ => break,
            };
            self.operator()?;
            let right = self.product()?;
            left = binary(op, left, right);
        }
        self.depth -= 1;
        Ok(left)
    }

    fn product(&mut self) -> Result<Expr, Syntax> {
        let mut left = self.unary()?;
        loop {
            let op = match self.peek() {
                Token::Symbol('*') => Operator::Mul,
                Token::Symbol('/') => Operator::Div,
                _ => return Ok(left),
            };
            self.operator()?;
            let right = self.unary()?;
            left = binary(op, left, right);
        }
    }

    fn unary(&mut self) -> Result<Expr, Syntax> {
        let at = self.offset();
        let mut negative = false;
        while matches!(self.peek(), Token::Symbol('-' | '+')) {
            negative ^= *self.peek() == Token::Symbol('-');
            self.advance();
        }
        let inner = self.power()?;
        Ok(if negative { Expr { at, kind: Kind::Negative(Box::new(inner)) } } else { inner })
    }

    fn power(&mut self) -> Result<Expr, Syntax> {
        let base = self.atom()?;
        if *self.peek() != Token::Symbol('^') {
            return Ok(base);
        }
        self.operator()?;
        self.deeper()?;
        let exponent = self.unary()?; // right to left, and 2^-1 is allowed
        self.depth -= 1;
        Ok(binary(Operator::Pow, base, exponent))
    }

    fn atom(&mut self) -> Result<Expr, Syntax> {
        let at = self.offset();
        match self.peek().clone() {
            Token::Number(x) => {
                self.advance();
                Ok(Expr { at, kind: Kind::Number(x) })
            }
            Token::Name(name) => {
                self.advance();
                if !self.accept('(') {
                    return Ok(Expr { at, kind: Kind::Name(name) });
                }
                let mut arguments = Vec::new();
                if !self.accept(')') {
                    loop {
                        arguments.push(self.sum()?);
                        if self.accept(')') {
                            break;
                        }
                        if !self.accept(',') {
                            return Err((
                                self.offset(),
                                format!(
                                    "\",\" or \")\" is wanted, {} is there",
                                    self.peek().name()
                                ),
                            ));
                        }
                    }
                }
                Ok(Expr { at, kind: Kind::Call(name, arguments) })
            }
            Token::Symbol('(') => {
                self.advance();
                let inner = self.sum()?;
                if !self.accept(')') {
                    return Err((
                        self.offset(),
                        format!("\")\" is wanted, {} is there", self.peek().name()),
                    ));
                }
                Ok(inner)
            }
            other => {
                Err((at, format!("a number, a name or \"(\" is wanted, {} is there", other.name())))
            }
        }
    }
}

fn binary(op: Operator, left: Expr, right: Expr) -> Expr {
    Expr { at: left.at, kind: Kind::Binary(op, Box::new(left), Box::new(right)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        fn eval(e: &Expr) -> f64 {
            match &e.kind {
                Kind::Number(x) => *x,
                Kind::Negative(a) => -eval(a),
                Kind::Binary(op, a, b) => match op {
                    Operator::Add => eval(a) + eval(b),
                    Operator::Sub => eval(a) - eval(b),
                    Operator::Mul => eval(a) * eval(b),
                    Operator::Div => eval(a) / eval(b),
                    Operator::Pow => eval(a).powf(eval(b)),
                },
                _ => f64::NAN,
            }
        }
        eval(&parse(text).unwrap())
    }

    #[test]
    fn precedence_is_that_of_the_field() {
        assert_eq!(value("1 + 2*3"), 7.0);
        assert_eq!(value("-2^2"), -4.0);
        assert_eq!(value("2^3^2"), 512.0);
        assert_eq!(value("2^-1"), 0.5);
        assert_eq!(value("8/2/2"), 2.0);
        assert_eq!(value("1 - 2 - 3"), -4.0);
        assert_eq!(value("2*-3"), -6.0);
        assert_eq!(value("1.5e-3*2E3"), 3.0);
        assert_eq!(value("--2"), 2.0);
    }

    #[test]
    fn mistakes_have_their_place() {
        assert_eq!(parse("a + * b").unwrap_err().0, 4);
        assert_eq!(parse("sin(a").unwrap_err().0, 5);
        assert_eq!(parse("a b").unwrap_err(), (2, "the name \"b\" is not expected here".into()));
        assert_eq!(parse("a # b").unwrap_err().0, 2);
        assert!(parse("").is_err());
        assert!(parse(&"(".repeat(10_000)).unwrap_err().1.contains("nested"));
        assert!(parse(&"2^".repeat(10_000)).unwrap_err().1.contains("nested"));
    }

    #[test]
    fn fault_a_very_long_or_very_deep_expression_is_refused_with_its_place() {
        const N: usize = 100_000;
        for joint in [" + ", " - ", " * ", " / "] {
            let (at, why) = parse(&vec!["a"; N].join(joint)).unwrap_err();
            assert_eq!(at, 4 * OPERATIONS + 2, "{why}");
            assert!(why.contains("more than 1000 operations"), "{why}");
            assert!(parse(&vec!["a"; OPERATIONS + 1].join(joint)).is_ok());
        }
        let deep = [
            format!("{}a{}", "(".repeat(N), ")".repeat(N)),
            format!("{}a{}", "sin(".repeat(N), ")".repeat(N)),
            format!("{}a", "a^".repeat(N)),
            format!("{}a{}", "-(".repeat(N), ")".repeat(N)),
            format!("{}a{}", "a*(".repeat(N), ")".repeat(N)),
        ];
        assert!(
            deep.iter().all(|text| parse(text).unwrap_err().1.contains("nested deeper than 200"))
        );
        assert!(parse(&format!("{}a", "-".repeat(N))).is_ok());
        // A long sum inside a long sum, as often as nesting goes.
        let sum = vec!["a"; 900].join("+");
        let nested = format!("{}a{}", format!("({sum} + ").repeat(150), ")".repeat(150));
        assert!(parse(&nested).unwrap_err().1.contains("operations"));
    }
}
