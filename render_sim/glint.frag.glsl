#version 330 core
// Linear radiance of the formula in render_sim/light.py, summed over the lamps' samples, with the
// body's markings blended as render_sim/markings.py states.
// Upper-case names are numbers put in before compilation, so that the loops have fixed bounds.

const int COUNT = LAMP_COUNT;
const vec4 lamp[COUNT] = vec4[](LAMP_SAMPLES);
const vec4 beam[COUNT] = vec4[](LAMP_BEAMS);  // direction and exponent
const int MARKS = MARK_COUNT;
const vec4 mark[] = vec4[](MARK_EXTENTS);   // station, half length, azimuth, half width
const vec4 paint[] = vec4[](MARK_PAINTS);   // roughness squared, specular, diffuse; 1 for an ellipse
const float pi = 3.14159265358979;

uniform vec3 cam_pos;
uniform vec3 own_surface;  // roughness squared, specular, diffuse

in vec3 world_position;
in vec3 world_normal;
in vec3 body_position;
out vec4 radiance;

float reflected(vec3 surface, vec3 n, vec3 v)
{
    float facing_eye = dot(n, v);
    float received = 0.0;
    float specular = 0.0;
    for (int j = 0; j < COUNT; ++j) {
        vec3 l = lamp[j].xyz - world_position;
        float r2 = dot(l, l);
        l *= inversesqrt(r2);
        float facing = max(dot(n, l), 0.0);
        float shone = max(-dot(l, beam[j].xyz), 0.0);
        float weight = lamp[j].w * pow(shone, beam[j].w) * facing / r2;
        float size2 = 2.0 + 2.0 * dot(l, v);
        float total = facing + facing_eye;
        float inverse2 = size2 / (total * total);
        received += weight;
        float bent = surface.x / (surface.x - 1.0 + inverse2);
        float lobe = GGX ? bent * bent : exp((1.0 - inverse2) / surface.x);
        float mirrored = surface.y + (1.0 - surface.y) * pow(1.0 - 0.5 * sqrt(size2), 5.0);
        specular += weight * mirrored * lobe * inverse2 * inverse2 / size2;
    }
    return surface.z * (received / pi + AMBIENT_PART) + specular / (pi * surface.x);
}

// Part of an interval about x, `wide` in all, that lies within `half_size` of zero.
float overlap(float x, float wide, float half_size)
{
    float low = max(x - 0.5 * wide, -half_size);
    return max(min(x + 0.5 * wide, half_size) - low, 0.0) / wide;
}

// Part of the fragment that a marking covers; `size` is the fragment's extent, station and azimuth.
float covered(int m, vec2 size)
{
    float turn = atan(body_position.y, body_position.z) - mark[m].z;
    turn -= 2.0 * pi * floor(turn / (2.0 * pi) + 0.5);
    vec2 away = vec2(body_position.x - mark[m].x, turn);
    vec2 reach = mark[m].yw;
    if (paint[m].w == 0.0)
        return overlap(away.x, size.x, reach.x) * overlap(away.y, size.y, reach.y);
    away /= reach;
    float distance = length(away);
    float edge = dot(abs(away), size / reach) / max(distance, 1e-6);
    return distance < 1e-4 ? 1.0 : clamp(0.5 + (1.0 - distance) / edge, 0.0, 1.0);
}

void main()
{
    vec3 n = normalize(world_normal);
    vec3 v = normalize(cam_pos - world_position);
    float light = reflected(own_surface, n, v);
    vec3 down = dFdy(body_position);
    float turned = (body_position.z * down.y - body_position.y * down.z)
        / dot(body_position.yz, body_position.yz);
    vec2 size = max(abs(vec2(dFdx(body_position.x), turned)), 1e-9);
    for (int m = 0; m < MARKS; ++m) {
        float part = covered(m, size);
        if (part > 0.0)
            light = mix(light, reflected(paint[m].xyz, n, v), part);
    }
    radiance = vec4(light, 0.0, 0.0, 1.0);
}
