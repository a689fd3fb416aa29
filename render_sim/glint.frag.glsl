#version 330 core
// Linear radiance of the formula in render_sim/light.py, summed over the lamps' samples.
// Upper-case names are numbers put in before compilation, so that the loop has a fixed bound.

const int COUNT = LAMP_COUNT;
const vec4 lamp[COUNT] = vec4[](LAMP_SAMPLES);
const vec4 beam[COUNT] = vec4[](LAMP_BEAMS);  // direction and exponent

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
        float shone = max(-dot(l, beam[j].xyz), 0.0);
        float weight = lamp[j].w * pow(shone, beam[j].w) * facing / r2;
        float size2 = 2.0 + 2.0 * dot(l, v);
        float total = facing + facing_eye;
        float inverse2 = size2 / (total * total);
        received += weight;
        float bent = ROUGHNESS_2 / (ROUGHNESS_2 - 1.0 + inverse2);
        float lobe = GGX ? bent * bent : exp((1.0 - inverse2) / ROUGHNESS_2);
        float mirrored = SPECULAR_PART + (1.0 - SPECULAR_PART) * pow(1.0 - 0.5 * sqrt(size2), 5.0);
        specular += weight * mirrored * lobe * inverse2 * inverse2 / size2;
    }
    const float pi = 3.14159265358979;
    float matte = DIFFUSE_PART * (received / pi + AMBIENT_PART);
    radiance = vec4(matte + specular / (pi * ROUGHNESS_2), 0.0, 0.0, 1.0);
}
