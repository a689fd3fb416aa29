#version 330 core
// Linear radiance of the formula in render_sim/light.py, summed over the lamp's samples.
// Upper-case names are numbers put in before compilation, so that the loop has a fixed bound.

const int COUNT = LAMP_COUNT;
const vec4 lamp[COUNT] = vec4[](LAMP_SAMPLES);

uniform vec3 cam_pos;

in vec3 world_position;
in vec3 world_normal;
out vec4 radiance;

void main()
{
    vec3 n = normalize(world_normal);
    vec3 v = normalize(cam_pos - world_position);
    float facing_eye = dot(n, v);
    float received = 0.0;
    float specular = 0.0;
    for (int j = 0; j < COUNT; ++j) {
        vec3 l = lamp[j].xyz - world_position;
        float r2 = dot(l, l);
        l *= inversesqrt(r2);
        float facing = max(dot(n, l), 0.0);
        float weight = lamp[j].w * max(l.z, 0.0) * facing / r2;
        float size2 = 2.0 + 2.0 * dot(l, v);
        float total = facing + facing_eye;
        float inverse2 = size2 / (total * total);
        received += weight;
        specular += weight * exp((1.0 - inverse2) / ROUGHNESS_2) * inverse2 * inverse2 / size2;
    }
    const float pi = 3.14159265358979;
    float matte = DIFFUSE_PART * (received / pi + AMBIENT_PART);
    radiance = vec4(matte + SPECULAR_PART * specular / (pi * ROUGHNESS_2), 0.0, 0.0, 1.0);
}
