// exp, ln, sin, cos and atan in the precision of the integrator: GLSL has them for single precision only.

#ifdef REAL64
double real_exp(double x) {
    double n = floor(x * 1.4426950408889634lf + 0.5lf);
    n = clamp(n, -1020.0lf, 1020.0lf);
    double r = (x - n * 0.693147180369123816490lf) - n * 1.90821492927058770002e-10lf;
    double sum = 1.0lf;
    for (int i = 13; i > 0; --i) {
        sum = 1.0lf + sum * r / double(i);
    }
    return ldexp(sum, int(n));
}

double real_ln(double x) {
    int e;
    double m = frexp(x, e);
    double y = double(log(float(m)));
    for (int i = 0; i < 2; ++i) {
        double t = real_exp(y);
        y += 2.0lf * (m - t) / (m + t);
    }
    return y + double(e) * 0.6931471805599453094lf;
}
double real_sin(double x) {
    double n = floor(x * 0.31830988618379067154lf + 0.5lf);
    double r = (x - n * 3.14159265358979311600lf) - n * 1.2246467991473531772e-16lf;
    double r2 = r * r;
    double sum = 1.0lf;
    for (int i = 11; i > 0; --i) {
        sum = 1.0lf - sum * r2 / double(2 * i * (2 * i + 1));
    }
    return mod(n, 2.0lf) == 0.0lf ? r * sum : -r * sum;
}

double real_cos(double x) {
    return real_sin(x + 1.57079632679489661923lf);
}

double real_atan(double x) {
    bool large = abs(x) > 1.0lf;
    double z = large ? 1.0lf / x : x;
    double y = double(atan(float(z)));
    double t = real_sin(y) / real_cos(y);
    double d = (z - t) / (1.0lf + z * t);
    y += d * (1.0lf - d * d * (1.0lf / 3.0lf - 0.2lf * d * d));
    return large ? (x > 0.0lf ? 1.57079632679489661923lf : -1.57079632679489661923lf) - y : y;
}
#else
float real_sin(float x) {
    return sin(x);
}

float real_cos(float x) {
    return cos(x);
}

float real_atan(float x) {
    return atan(x);
}

float real_exp(float x) {
    return exp(x);
}

float real_ln(float x) {
    return log(x);
}
#endif
