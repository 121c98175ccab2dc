// exp and ln in the precision of the integrator: GLSL has them for single precision only.

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
#else
float real_exp(float x) {
    return exp(x);
}

float real_ln(float x) {
    return log(x);
}
#endif
